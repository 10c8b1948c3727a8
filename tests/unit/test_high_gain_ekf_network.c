/* Adaptive high-gain EKF over networks that delay, lose and keep silent, and with a predictor that
 * knows the plant badly. Agreement with independent runs is the golden tests' matter. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "dse/high_gain_ekf.h"
#include "dse/math.h"
#include "dse/ode.h"
#include "dse/plant.h"

#ifdef DSE_REAL_IS_float
#define TOLERANCE(in_double, in_float) DSE_REAL(in_float)
#else
#define TOLERANCE(in_double, in_float) DSE_REAL(in_double)
#endif

enum { P = 2, N = 4, D = 3, EVERY = 5, HORIZON = 4 };

#define STORAGE                                                                                    \
    (DSE_HIGH_GAIN_EKF_STORAGE(N, 2, P, P, 2, HORIZON) +                                           \
     DSE_HIGH_GAIN_EKF_DELAY_STORAGE(N, 2, P, D, EVERY))

static void assert_near(dse_real got, dse_real want, dse_real tolerance)
{
    if (!(dse_abs(got - want) <= tolerance)) {
        fail_msg("%.17g is not %.17g within %g", (double)got, (double)want, (double)tolerance);
    }
}

/* Two reactors of section 4.7 and their filters. */
struct network {
    dse_real prepared[256];
    struct dse_model model;
    struct dse_normal_form form;
    dse_real x[N], u[2], x0[N], P0[4], Q[4];
    struct dse_high_gain_ekf_config config[P];
    struct dse_high_gain_ekf filter[P];
    dse_real memory[P][STORAGE];
    int64_t k;
    /* what the filters said at the instants */
    dse_real said[P][64][2];
};

static void prepare(dse_real *prepared, const char *parameter, dse_real change)
{
    const struct dse_plant *plant = dse_plant_find("cstr2");
    dse_real values[DSE_PLANT_MAX_PARAMETERS];
    memcpy(values, plant->sets[1].values, (size_t)plant->n_parameters * sizeof *values);
    for (int i = 0; i < plant->n_parameters; i++) {
        values[i] += strcmp(plant->parameters[i].name, parameter) == 0 ? change : 0;
    }
    assert_int_equal(plant->prepare(values, prepared), DSE_OK);
}

static struct dse_high_gain_ekf_config base_config(void)
{
    return (struct dse_high_gain_ekf_config){.period = DSE_REAL(1) / 3600,
                                             .coords = DSE_HIGH_GAIN_PHYSICAL,
                                             .scaling = DSE_HIGH_GAIN_PLAIN,
                                             .comm_every_ticks = EVERY,
                                             .max_delay = D,
                                             .R = 1,
                                             .adaptation = {.theta_m = 10,
                                                            .rise_time = DSE_REAL(0.001),
                                                            .relaxation = 1000,
                                                            .sharpness = 5,
                                                            .threshold = 1},
                                             .horizon = HORIZON};
}

static void open_network(struct network *network, const struct dse_high_gain_ekf_config *config)
{
    const struct dse_plant *plant = dse_plant_find("cstr2");
    *network = (struct network){.x = {360, 3, 320, 3},
                                .u = {DSE_REAL(4.998), 0},
                                .x0 = {365, DSE_REAL(2.5), 325, DSE_REAL(3.5)},
                                .P0 = {1, 0, 0, 1},
                                .Q = {50, 0, 0, 5}};
    prepare(network->prepared, "", 0);
    plant->model(network->prepared, &network->model);
    plant->normal_form(network->prepared, &network->form);
    for (int i = 0; i < P; i++) {
        struct dse_arena arena;
        network->config[i] = *config;
        network->config[i].model = &network->model;
        network->config[i].form = &network->form;
        network->config[i].i = i;
        network->config[i].x0 = network->x0;
        network->config[i].P0 = network->P0;
        network->config[i].Q = network->Q;
        dse_arena_init(&arena, network->memory[i], STORAGE);
        assert_int_equal(dse_high_gain_ekf_init(&network->filter[i], &network->config[i], &arena),
                         DSE_OK);
    }
}

static void begin(struct network *network)
{
    dse_real y[P];
    const dse_real t = (dse_real)network->k * network->config[0].period;
    assert_int_equal(network->model.h(&network->model, t, network->x, network->u, y), DSE_OK);
    for (int i = 0; i < P; i++) {
        const struct dse_measurement own = {.y = y + i};
        dse_real message[DSE_HIGH_GAIN_EKF_MESSAGE(2)];
        assert_int_equal(
            dse_high_gain_ekf_begin(&network->filter[i], network->k, t, network->u, &own), DSE_OK);
        if (dse_high_gain_ekf_message(&network->filter[i], 0, message) > 1) {
            memcpy(network->said[i][network->k / EVERY], message + 1, 2 * sizeof *message);
        }
    }
}

/* What j said at instant `stamp` reaches i now. */
static enum dse_status deliver(struct network *network, int i, int64_t stamp)
{
    return dse_high_gain_ekf_deliver(&network->filter[i], 1 - i, stamp * EVERY,
                                     network->said[1 - i][stamp], 2);
}

static void end(struct network *network)
{
    dse_real scratch[DSE_RK4_SCRATCH(N)];
    const dse_real h = network->config[0].period;
    for (int i = 0; i < P; i++) {
        for (int r = 0; r < dse_high_gain_ekf_rounds(&network->filter[i]); r++) {
            assert_int_equal(dse_high_gain_ekf_advance(&network->filter[i], r), DSE_OK);
        }
        assert_int_equal(dse_high_gain_ekf_finish(&network->filter[i]), DSE_OK);
    }
    assert_int_equal(dse_rk4_model_step(&network->model, (dse_real)network->k * h, h, network->u,
                                        network->x, scratch),
                     DSE_OK);
    network->k++;
}

/* One tick; at instants packet of stamp s arrives where due[s] == instant. */
static void tick(struct network *network, const int *due, int stamps)
{
    begin(network);
    for (int s = 0; s < stamps && network->k % EVERY == 0; s++) {
        for (int i = 0; i < P && due[s] == (int)(network->k / EVERY); i++) {
            assert_int_equal(deliver(network, i, s), DSE_OK);
        }
    }
    end(network);
}

static void assert_same_pictures(const struct network *a, const struct network *b)
{
    for (int i = 0; i < P; i++) {
        assert_memory_equal(dse_high_gain_ekf_picture(&a->filter[i]),
                            dse_high_gain_ekf_picture(&b->filter[i]), N * sizeof(dse_real));
        assert_memory_equal(dse_high_gain_ekf_covariance(&a->filter[i]),
                            dse_high_gain_ekf_covariance(&b->filter[i]), 4 * sizeof(dse_real));
    }
}

/* ---- delays ---- */

static void packets_without_delay_are_a_plain_exchange(void **state)
{
    (void)state;
    static struct network late, plain;
    static const enum dse_high_gain_predictor predictors[] = {DSE_HIGH_GAIN_PREDICT,
                                                              DSE_HIGH_GAIN_HOLD};
    for (int p = 0; p < 2; p++) {
        struct dse_high_gain_ekf_config config = base_config();
        config.predictor = predictors[p];
        open_network(&late, &config);
        config.max_delay = 0;
        open_network(&plain, &config);
        static const int due[] = {0, 1, 2, 3, 4, 5, 6, 7};
        for (int k = 0; k < 8 * EVERY; k++) {
            tick(&late, due, 8);
            tick(&plain, due, 8);
        }
        assert_same_pictures(&late, &plain);
        assert_int_equal(dse_high_gain_ekf_counters(&late.filter[0])->replayed_ticks, 0);
    }
}

/* (4.1): from the corrected picture of the packet's instant the whole model runs to now, where the
 * own block is what the filter knows. */
static void late_state_moves_with_the_model_to_the_present(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = base_config();
    static const int never[] = {-1};
    open_network(&network, &config);
    for (int k = 0; k < 2 * EVERY; k++) {
        tick(&network, never, 1);
    }
    dse_real own0[2], own1[2], want[N], scratch[DSE_RK4_SCRATCH(N)];
    memcpy(own0, network.said[0][0], sizeof own0);
    memcpy(own1, network.said[0][1], sizeof own1);
    memcpy(want, own0, sizeof own0);
    memcpy(want + 2, network.said[1][0], sizeof own0);
    for (int k = 0; k < 2 * EVERY; k++) {
        if (k == EVERY) {
            memcpy(want, own1, sizeof own1);
        }
        assert_int_equal(dse_rk4_model_step(&network.model, (dse_real)k * config.period,
                                            config.period, network.u, want, scratch),
                         DSE_OK);
    }
    begin(&network);
    assert_int_equal(deliver(&network, 0, 0), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_age(&network.filter[0], 1), 2);
    assert_int_equal(dse_high_gain_ekf_advance(&network.filter[0], 0), DSE_OK);
    for (int r = 0; r < 2; r++) {
        assert_near(network.filter[0].base[2 + r], want[2 + r], TOLERANCE(1e-11, 1e-3));
        assert_near(network.filter[0].base[r], network.said[0][2][r], 0);
    }
    assert_int_equal(dse_high_gain_ekf_counters(&network.filter[0])->replayed_ticks, 2 * EVERY);
}

static void order_of_arrival_within_an_instant_does_not_matter(void **state)
{
    (void)state;
    static struct network a, b;
    const struct dse_high_gain_ekf_config config = base_config();
    static const int never[] = {-1};
    open_network(&a, &config);
    open_network(&b, &config);
    for (int k = 0; k < 3 * EVERY; k++) {
        tick(&a, never, 1);
        tick(&b, never, 1);
    }
    begin(&a);
    begin(&b);
    for (int s = 0; s < 3; s++) {
        assert_int_equal(deliver(&a, 0, s), DSE_OK);
        assert_int_equal(deliver(&b, 0, 2 - s), DSE_OK);
    }
    assert_int_equal(deliver(&b, 0, 1), DSE_OK); /* a duplicate */
    assert_int_equal(dse_high_gain_ekf_counters(&b.filter[0])->duplicates, 1);
    end(&a);
    end(&b);
    assert_same_pictures(&a, &b);
}

static void held_state_does_not_change_when_an_older_one_comes(void **state)
{
    (void)state;
    static struct network a, b;
    struct dse_high_gain_ekf_config config = base_config();
    config.predictor = DSE_HIGH_GAIN_HOLD;
    open_network(&a, &config);
    open_network(&b, &config);
    static const int in_order[] = {0, -1, 3}, out_of_order[] = {0, 4, 3};
    for (int k = 0; k < 6 * EVERY; k++) {
        tick(&a, in_order, 3);
        tick(&b, out_of_order, 3);
    }
    assert_same_pictures(&a, &b);
}

/* Two states of the only neighbour: at the newer one's instant everything is known. */
static void older_state_of_a_single_neighbour_adds_nothing_to_a_newer_one(void **state)
{
    (void)state;
    static struct network a, b;
    const struct dse_high_gain_ekf_config config = base_config();
    open_network(&a, &config);
    open_network(&b, &config);
    static const int with_old[] = {0, 3, 3}, without[] = {0, -1, 3};
    for (int k = 0; k < 6 * EVERY; k++) {
        tick(&a, with_old, 3);
        tick(&b, without, 3);
    }
    assert_same_pictures(&a, &b);
}

static void states_beyond_the_bound_are_dropped_and_counted(void **state)
{
    (void)state;
    static struct network a, b;
    const struct dse_high_gain_ekf_config config = base_config();
    static const int lost[] = {0, -1}, too_late[] = {0, 1 + D + 1}, in_time[] = {0, 1 + D};
    open_network(&a, &config);
    open_network(&b, &config);
    for (int k = 0; k < 7 * EVERY; k++) {
        tick(&a, lost, 2);
        tick(&b, too_late, 2);
    }
    assert_same_pictures(&a, &b);
    assert_int_equal(dse_high_gain_ekf_counters(&b.filter[0])->too_late, 1);
    /* stamps 1 to 3 had their last chance at instants 4 to 6 */
    assert_int_equal(dse_high_gain_ekf_counters(&b.filter[0])->missing_states, 3);
    open_network(&b, &config);
    for (int k = 0; k < 7 * EVERY; k++) {
        tick(&b, in_time, 2);
    }
    assert_int_equal(dse_high_gain_ekf_counters(&b.filter[0])->too_late, 0);
    assert_int_equal(dse_high_gain_ekf_counters(&b.filter[0])->missing_states, 2);
}

static void hold_keeps_the_newest_state_until_a_newer_one_comes(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = base_config();
    config.predictor = DSE_HIGH_GAIN_HOLD;
    open_network(&network, &config);
    static const int due[] = {0, -1, 4, 3};
    static const int held[] = {0, 0, 0, 3, 3, 3};
    for (int k = 0; k < 6 * EVERY; k++) {
        tick(&network, due, 4);
        assert_memory_equal(dse_high_gain_ekf_picture(&network.filter[0]) + 2,
                            network.said[1][held[k / EVERY]], 2 * sizeof(dse_real));
        assert_int_equal(dse_high_gain_ekf_age(&network.filter[0], 1), k / EVERY - held[k / EVERY]);
    }
}

/* From the true state nothing is to be corrected, whatever is late, and also where the feed jumps
 * and moves under the packets: the past is computed with the inputs of the past, and in normal
 * coordinates encoded anew at each jump. */
static void what_is_exact_stays_exact_under_delays_and_jumping_inputs(void **state)
{
    (void)state;
    static struct network network;
    static const enum dse_high_gain_coords coords[] = {DSE_HIGH_GAIN_PHYSICAL, DSE_HIGH_GAIN_MAPPED,
                                                       DSE_HIGH_GAIN_NORMAL};
    static const int due[] = {0, 3, -1, 5, 7, 5, -1, 10, 8, 9, -1, -1, 15, 13};
    for (int c = 0; c < 3; c++) {
        struct dse_high_gain_ekf_config config = base_config();
        config.coords = coords[c];
        open_network(&network, &config);
        memcpy(network.x, network.x0, sizeof network.x);
        for (int k = 0; k < 16 * EVERY; k++) {
            /* jumps within the periods; in between it moves at a known rate */
            network.u[0] = 5 + (dse_real)(k / 7 % 3);
            network.u[1] = k / 11 % 2 == 0 ? 0 : 30;
            tick(&network, due, 14);
            for (int i = 0; i < P; i++) {
                const dse_real *picture = dse_high_gain_ekf_picture(&network.filter[i]);
                dse_real chi[N],
                    end_u[2] = {network.u[0] + network.u[1] * config.period, network.u[1]};
                memcpy(chi, picture, sizeof chi);
                if (coords[c] == DSE_HIGH_GAIN_NORMAL) {
                    assert_int_equal(network.form.decode(&network.form, 0, picture, end_u, chi),
                                     DSE_OK);
                }
                /* the plant of the test holds its input over a tick, so the rate costs O(h) */
                for (int s = 0; s < N; s++) {
                    assert_near(chi[s], network.x[s], DSE_REAL(0.05));
                }
            }
        }
        assert_true(dse_high_gain_ekf_counters(&network.filter[0])->replayed_ticks > 5 * EVERY);
    }
}

static void delays_keep_the_largest_age_within_the_bound(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = base_config();
    const struct dse_link_config lossy = {.max_delay = D, .max_losses = 2, .loss = 0.4, .seed = 4};
    dse_real memory[P][DSE_LINE_STORAGE(D, 2)];
    struct dse_link link[P];
    struct dse_line line[P];
    int largest = 0;
    open_network(&network, &config);
    for (int i = 0; i < P; i++) {
        struct dse_arena arena;
        dse_arena_init(&arena, memory[i], DSE_LINE_STORAGE(D, 2));
        assert_int_equal(dse_link_init(&link[i], &lossy, i, 1 - i), DSE_OK);
        assert_int_equal(dse_line_init(&line[i], D, 2, &arena), DSE_OK);
    }
    for (int k = 0; k < 60 * EVERY; k++) {
        begin(&network);
        for (int i = 0; i < P && k % EVERY == 0; i++) {
            const int64_t now = k / EVERY;
            const dse_real *arrived;
            int64_t stamp;
            dse_line_put(&line[i], now, dse_link_fate(&link[i], now), network.said[1 - i][now]);
            while ((arrived = dse_line_take(&line[i], now, &stamp)) != NULL) {
                assert_int_equal(
                    dse_high_gain_ekf_deliver(&network.filter[i], 1 - i, stamp * EVERY, arrived, 2),
                    DSE_OK);
            }
            const int age = dse_high_gain_ekf_largest_age(&network.filter[i]);
            assert_in_range(age, 0, DSE_LINK_MAX_AGE(D, 2));
            largest = age > largest ? age : largest;
        }
        end(&network);
    }
    assert_true(largest >= 3);
}

static void deliveries_that_cannot_be_are_refused(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = base_config();
    struct dse_high_gain_ekf *f = &network.filter[0];
    const dse_real good[2] = {350, 3}, nan[2] = {350, (dse_real)NAN};
    open_network(&network, &config);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, 0, good, 2), DSE_EINVAL); /* no tick open */
    begin(&network);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 0, 0, good, 2), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 2, 0, good, 2), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, -EVERY, good, 2), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, EVERY, good, 2), DSE_EINVAL); /* future */
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, 0, NULL, 2), DSE_EINVAL);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, 0, good, 3), DSE_EFORMAT);
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, 0, nan, 2), DSE_ENONFINITE);
    assert_int_equal(dse_high_gain_ekf_counters(f)->refused, 8);
    assert_int_equal(dse_high_gain_ekf_age(f, 1), -1);
    assert_int_equal(dse_high_gain_ekf_largest_age(f), -1);
    end(&network);
    begin(&network); /* no instant */
    assert_int_equal(dse_high_gain_ekf_deliver(f, 1, 0, good, 2), DSE_EINVAL);
}

static void past_before_a_gap_in_the_samples_is_not_replayed(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config config = base_config();
    static const int never[] = {-1};
    struct dse_high_gain_ekf *f = &network.filter[0];
    open_network(&network, &config);
    for (int k = 0; k < 2 * EVERY; k++) {
        tick(&network, never, 1);
    }
    network.k++; /* the sample of instant 2 is left out */
    while (network.k < 4 * EVERY) {
        tick(&network, never, 1);
    }
    begin(&network);
    assert_int_equal(deliver(&network, 0, 1), DSE_OK);
    assert_int_equal(dse_high_gain_ekf_advance(f, 0), DSE_OK);
    /* from instant 3 on there is a past, and it does not know what came of stamp 1 */
    assert_int_equal(dse_high_gain_ekf_counters(f)->replayed_ticks, EVERY);
}

/* A model that has no past: it fails before a time. */
struct forgetful {
    const struct dse_model *model;
    dse_real since;
};

static enum dse_status forgetful_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *dx)
{
    const struct forgetful *forgetful = model->parameters;
    return t < forgetful->since ? DSE_EMODEL : forgetful->model->f(forgetful->model, t, x, u, dx);
}

static void replay_that_fails_leaves_the_running_picture(void **state)
{
    (void)state;
    static struct network a, b;
    struct dse_high_gain_ekf_config config = base_config();
    static const int due[] = {0, 3}, lost[] = {0, -1};
    open_network(&b, &config);
    struct forgetful forgetful = {.model = &a.model};
    struct dse_model wrapper = {.time = DSE_CONTINUOUS,
                                .nx = N,
                                .nu = 2,
                                .ny = P,
                                .parameters = &forgetful,
                                .f = forgetful_f};
    config.predictor_model = &wrapper;
    open_network(&a, &config);
    for (int k = 0; k < 4 * EVERY; k++) {
        forgetful.since = ((dse_real)k - DSE_REAL(0.5)) * config.period;
        tick(&a, due, 2);
        tick(&b, lost, 2);
    }
    assert_int_equal(dse_high_gain_ekf_counters(&a.filter[0])->failed_replays, 1);
    assert_same_pictures(&a, &b);
}

/* ---- triggers ---- */

static void silent_filter_is_held_and_no_loss_is_counted(void **state)
{
    (void)state;
    static struct network network;
    struct dse_high_gain_ekf_config config = base_config();
    config.communication = DSE_HIGH_GAIN_TRIGGERED;
    config.innovation = DSE_HIGH_GAIN_SUM;
    config.predictor = DSE_HIGH_GAIN_HOLD;
    config.max_delay = 0;
    config.trigger = (struct dse_trigger_config){.threshold = 3};
    open_network(&network, &config);
    dse_real last[P][2] = {{0}};
    int heard = 0, told[P] = {0}, lost = 0;
    for (int k = 0; k < 40 * EVERY; k++) {
        dse_real message[P][DSE_HIGH_GAIN_EKF_MESSAGE(2)];
        int count[P];
        const bool deaf = k >= 2 * EVERY && k < 8 * EVERY; /* 1 does not hear 0 */
        begin(&network);
        for (int i = 0; i < P; i++) {
            const dse_real *own = network.filter[i].base + 2 * i;
            const bool far =
                told[i] == 0 || !(dse_sqrt((own[0] - last[i][0]) * (own[0] - last[i][0]) +
                                           (own[1] - last[i][1]) * (own[1] - last[i][1])) < 3);
            count[i] = dse_high_gain_ekf_message(&network.filter[i], 0, message[i]);
            assert_int_equal(count[i], k % EVERY == 0 && far ? 4 : 2);
            if (count[i] == 4) {
                memcpy(last[i], own, sizeof last[i]);
                told[i]++;
            }
            assert_near(message[i][1], (dse_real)told[i], 0);
        }
        assert_int_equal(dse_high_gain_ekf_receive(&network.filter[0], 0, 1, message[1], count[1]),
                         DSE_OK);
        if (!deaf) {
            assert_int_equal(
                dse_high_gain_ekf_receive(&network.filter[1], 0, 0, message[0], count[0]), DSE_OK);
            heard += count[0] == 4;
        } else {
            lost += count[0] == 4;
        }
        end(&network);
    }
    assert_true(told[0] > 3 && told[0] < 30 && lost > 0);
    assert_int_equal(dse_high_gain_ekf_counters(&network.filter[0])->missing_states, 0);
    assert_int_equal(dse_high_gain_ekf_counters(&network.filter[1])->missing_states, lost);
    assert_int_equal(dse_high_gain_ekf_counters(&network.filter[0])->transmissions, told[0]);
    assert_int_equal(heard + lost, told[0]);
    assert_memory_equal(dse_high_gain_ekf_picture(&network.filter[1]), last[0], sizeof last[0]);
}

static void relative_trigger_watches_the_physical_estimate(void **state)
{
    (void)state;
    static struct network network;
    static const dse_real H[2] = {200, 1};
    struct dse_high_gain_ekf_config config = base_config();
    config.coords = DSE_HIGH_GAIN_NORMAL;
    config.communication = DSE_HIGH_GAIN_TRIGGERED;
    config.max_delay = 0;
    config.trigger = (struct dse_trigger_config){
        .norm = DSE_TRIGGER_RELATIVE, .threshold = DSE_REAL(0.5), .weights = H};
    open_network(&network, &config);
    dse_real last[2] = {0};
    int told = 0, silent = 0;
    for (int k = 0; k < 40 * EVERY; k++) {
        begin(&network);
        const dse_real *chi = dse_high_gain_ekf_estimate(&network.filter[0]);
        if (k % EVERY == 0) {
            const dse_real a = 200 * (chi[0] - last[0]) / last[0], b = (chi[1] - last[1]) / last[1];
            const bool far = k == 0 || !(dse_sqrt(a * a + b * b) < DSE_REAL(0.5));
            assert_int_equal(dse_high_gain_ekf_tells(&network.filter[0]), far);
            told += far;
            silent += !far;
            if (far) {
                memcpy(last, chi, sizeof last);
            }
        } else {
            assert_false(dse_high_gain_ekf_tells(&network.filter[0]));
        }
        end(&network);
    }
    assert_true(told > 2 && silent > 2);
}

/* ---- a predictor with a model of its own ---- */

static void predictor_moves_only_the_neighbours_by_its_own_model(void **state)
{
    (void)state;
    static struct network network;
    static const enum dse_high_gain_coords coords[] = {DSE_HIGH_GAIN_PHYSICAL, DSE_HIGH_GAIN_MAPPED,
                                                       DSE_HIGH_GAIN_NORMAL};
    /* filter 2 believes in 5 m3/h more recycle into reactor 1 */
    dse_real prepared[256];
    struct dse_model wrong;
    prepare(prepared, "dFr", 5);
    dse_plant_find("cstr2")->model(prepared, &wrong);
    for (int c = 0; c < 3; c++) {
        struct dse_high_gain_ekf_config config = base_config();
        config.coords = coords[c];
        config.predictor_model = &wrong;
        config.gain = DSE_HIGH_GAIN_ONE;
        open_network(&network, &config);
        const dse_real h = config.period;
        struct dse_high_gain_ekf *f = &network.filter[1];
        assert_int_equal(dse_high_gain_ekf_begin(f, 1, h, network.u, NULL), DSE_OK);
        assert_int_equal(dse_high_gain_ekf_finish(f), DSE_OK);
        dse_real chi[N], right[N], mixed[N];
        memcpy(chi, dse_high_gain_ekf_picture(f), sizeof chi);
        if (coords[c] == DSE_HIGH_GAIN_NORMAL) {
            assert_int_equal(
                network.form.decode(&network.form, 0, dse_high_gain_ekf_picture(f), network.u, chi),
                DSE_OK);
        }
        /* Euler, good to O(h^2): reactor 1 as the wrong model, reactor 2 as the right one */
        assert_int_equal(network.model.f(&network.model, 0, network.x0, network.u, right), DSE_OK);
        assert_int_equal(wrong.f(&wrong, 0, network.x0, network.u, mixed), DSE_OK);
        assert_true(dse_abs(mixed[0] - right[0]) > 100); /* K/h */
        assert_near(chi[0], network.x0[0] + h * mixed[0], TOLERANCE(2e-2, 2e-2));
        assert_true(dse_abs(h * (mixed[0] - right[0])) > DSE_REAL(4e-2));
        assert_near(chi[2], network.x0[2] + h * right[2], TOLERANCE(2e-2, 2e-2));
    }
}

static void predictor_with_the_same_model_is_no_predictor_of_its_own(void **state)
{
    (void)state;
    static struct network a, b;
    static const int due[] = {0, 3, 2, -1, 6, 5};
    for (int c = 0; c < 3; c++) {
        struct dse_high_gain_ekf_config config = base_config();
        config.coords = (enum dse_high_gain_coords)c;
        open_network(&a, &config);
        config.predictor_model = &a.model;
        open_network(&b, &config);
        for (int k = 0; k < 8 * EVERY; k++) {
            tick(&a, due, 6);
            tick(&b, due, 6);
        }
        assert_same_pictures(&a, &b);
    }
}

static enum dse_status init_with(const struct dse_high_gain_ekf_config *config, int missing)
{
    static dse_real memory[STORAGE];
    struct dse_high_gain_ekf filter;
    struct dse_arena arena;
    dse_arena_init(&arena, memory, STORAGE - missing);
    const enum dse_status status = dse_high_gain_ekf_init(&filter, config, &arena);
    if (status == DSE_OK) {
        assert_int_equal(arena.used, STORAGE);
    }
    return status;
}

#define REFUSES(status, change)                                                                    \
    do {                                                                                           \
        struct dse_high_gain_ekf_config config = good;                                             \
        change;                                                                                    \
        assert_int_equal(init_with(&config, 0), status);                                           \
    } while (0)

static void impossible_networks_are_refused(void **state)
{
    (void)state;
    static struct network network;
    const struct dse_high_gain_ekf_config base = base_config();
    open_network(&network, &base);
    const struct dse_high_gain_ekf_config good = network.config[0];
    assert_int_equal(init_with(&good, 0), DSE_OK);
    assert_int_equal(init_with(&good, 1), DSE_ESTORAGE);
    REFUSES(DSE_EINVAL, config.max_delay = -1);
    REFUSES(DSE_EINVAL, config.communication = DSE_HIGH_GAIN_TRIGGERED);
    REFUSES(DSE_EINVAL, config.communication = DSE_HIGH_GAIN_STAGES; config.comm_every_ticks = 1);
    REFUSES(DSE_EINVAL, config.trigger.threshold = -1);
    struct dse_model other = network.model;
    other.nx = 3;
    REFUSES(DSE_EDIM, config.predictor_model = &other);
    other = network.model;
    other.time = DSE_DISCRETE;
    REFUSES(DSE_EINVAL, config.predictor_model = &other);
    struct dse_normal_form form = network.form;
    form.push = NULL;
    REFUSES(DSE_OK, config.form = &form; config.predictor_model = &network.model);
    REFUSES(DSE_EINVAL, config.form = &form; config.predictor_model = &network.model;
            config.coords = DSE_HIGH_GAIN_NORMAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(packets_without_delay_are_a_plain_exchange),
        cmocka_unit_test(late_state_moves_with_the_model_to_the_present),
        cmocka_unit_test(order_of_arrival_within_an_instant_does_not_matter),
        cmocka_unit_test(held_state_does_not_change_when_an_older_one_comes),
        cmocka_unit_test(older_state_of_a_single_neighbour_adds_nothing_to_a_newer_one),
        cmocka_unit_test(states_beyond_the_bound_are_dropped_and_counted),
        cmocka_unit_test(hold_keeps_the_newest_state_until_a_newer_one_comes),
        cmocka_unit_test(what_is_exact_stays_exact_under_delays_and_jumping_inputs),
        cmocka_unit_test(delays_keep_the_largest_age_within_the_bound),
        cmocka_unit_test(deliveries_that_cannot_be_are_refused),
        cmocka_unit_test(past_before_a_gap_in_the_samples_is_not_replayed),
        cmocka_unit_test(replay_that_fails_leaves_the_running_picture),
        cmocka_unit_test(silent_filter_is_held_and_no_loss_is_counted),
        cmocka_unit_test(relative_trigger_watches_the_physical_estimate),
        cmocka_unit_test(predictor_moves_only_the_neighbours_by_its_own_model),
        cmocka_unit_test(predictor_with_the_same_model_is_no_predictor_of_its_own),
        cmocka_unit_test(impossible_networks_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
