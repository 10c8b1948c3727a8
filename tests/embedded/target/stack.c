/* Memory of the estimators on this processor and the stack that one step of each takes. Linked with
 * every object of the library, so that checks/stack.py finds all of them, and all that they need of
 * the compiler's runtime, in one image. */
#include <stddef.h>

#include "cstr2_network.h"
#include "dse/ekf.h"
#include "dse/window_qp.h"
#include "report.h"
#include "stack_meter.h"

/* The example's own functions. */
enum dse_status estimator_start(void);
const struct dse_ekf *estimator_sample(dse_real t, dse_real pump, dse_real level);

static struct cstr2_network network;
static enum dse_status result;

/* One predict and update of the continuous EKF with 2 states (checks/stack.py knows the names). */
static void step_ekf(void)
{
    dse_real t = dse_ekf_time(estimator_sample(0, 0, DSE_REAL(0.5)));
    const struct dse_ekf *ekf = estimator_sample(t + 1, 0, DSE_REAL(0.5));
    result = dse_ekf_health(ekf) == DSE_HEALTH_DIVERGED ? DSE_EMODEL : DSE_OK;
}

/* One tick of two high-gain filters with 2 of 4 states each, and of their plant. */
static void step_high_gain_ekf(void)
{
    result = cstr2_network_tick(&network);
}

/* A window QP of two stages with one unknown each, whose own search is switched off, and a second
 * opinion that has none: the least that a backend takes of the stack. */
static enum dse_status no_opinion(void *context, const struct dse_window_qp_problem *problem,
                                  dse_real *y)
{
    (void)context;
    (void)problem;
    (void)y;
    return DSE_ENOCONV;
}

static void step_window_qp(void)
{
    static const struct dse_window_qp_backend backend = {no_opinion, NULL};
    static const struct dse_window_qp_config config = {
        .nz = 1, .stages = 2, .max_passes = -1, .max_steps = -1, .backend = &backend};
    static const dse_real P[1] = {2}, below[1] = {-1}, c[2] = {1, 1}, upper[2] = {0, 0};
    static const dse_real *const diagonal[2] = {P, P}, *const beside[1] = {below};
    static dse_real memory[DSE_WINDOW_QP_STORAGE(1, 0, 2, 2)];
    static struct dse_window_qp qp;
    const struct dse_window_qp_problem problem = {
        .stages = 2, .diagonal = diagonal, .below = beside, .c = c, .bounds = {.upper = upper}};
    struct dse_arena arena;
    dse_arena_init(&arena, memory, DSE_WINDOW_QP_STORAGE(1, 0, 2, 2));
    result = dse_window_qp_init(&qp, &config, &arena);
    if (result == DSE_OK)
        result = dse_window_qp_factor(&qp, &problem, 1);
    if (result == DSE_OK && dse_window_qp_solve(&qp, &problem) != DSE_ENOCONV)
        result = DSE_EINVAL;
}

static void storage(const char *name, int reals)
{
    report_int(name, reals * (int)sizeof(dse_real));
}

static void report_storage(void)
{
    storage("bytes of arena, discrete EKF (nx 4, ny 2)", DSE_EKF_STORAGE(4, 2));
    storage("bytes of arena, discrete EKF (nx 8, ny 4)", DSE_EKF_STORAGE(8, 4));
    storage("bytes of arena, continuous EKF (nx 4, ny 2)", DSE_EKF_STORAGE_CONTINUOUS(4, 2));
    storage("bytes of arena, continuous EKF (nx 8, ny 4)", DSE_EKF_STORAGE_CONTINUOUS(8, 4));
    storage("bytes of arena, high-gain EKF (2 of 4 states, horizon 72)", cstr2_network_storage());
    storage("bytes of arena, window QP (9 states, 10 samples, 20 active)",
            DSE_WINDOW_QP_STORAGE(9, 9, 10, 20));
    report_int("bytes of struct dse_ekf", (int)sizeof(struct dse_ekf));
    report_int("bytes of struct dse_high_gain_ekf", (int)sizeof(struct dse_high_gain_ekf));
}

int main(void)
{
    report_storage();
    report_check("the example starts", estimator_start() == DSE_OK);
    report_int("stack ekf", stack_used_by(step_ekf));
    report_check("a step of the EKF succeeds", result == DSE_OK);
    report_check("the network starts", cstr2_network_start(&network) == DSE_OK);
    report_int("stack high_gain_ekf", stack_used_by(step_high_gain_ekf));
    report_check("a tick of the high-gain EKF succeeds", result == DSE_OK);
    report_int("stack window_qp", stack_used_by(step_window_qp));
    report_check("a window QP without a search has no solution", result == DSE_OK);
    return report_verdict();
}
