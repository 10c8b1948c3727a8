/* From the section to the configuration of the libdse objects. */
#include <math.h>
#include <stdlib.h>

#include "methods/coordinated_mhe_node.h"

#define UNBOUNDED   1e30
#define DEFAULT_EPS 1e-3

static const enum dse_mhe_scheme lib_schemes[] = {
    [COORDINATED_MHE_PREDICTION] = DSE_MHE_PREDICTION,
    [COORDINATED_MHE_PRICE] = DSE_MHE_PRICE,
    [COORDINATED_MHE_DECENTRALISED] = DSE_MHE_ALONE,
    [COORDINATED_MHE_CENTRALISED] = DSE_MHE_ALONE,
};

/* ---- numbers that the configuration points to ---- */

/* All matrices of all subsystems (A, C, Q, R, D, P^-1), x0 and four bounds, the start-up
 * prediction and its scratch, two lists of weights, the cost of interactions and its scratch. */
static size_t numbers_needed(const struct coordinated_mhe_node *node)
{
    size_t n = (size_t)node->plant.n;
    size_t ny = (size_t)node->plant.ny;
    return 5 * n * n + 2 * ny * ny + ny * n + 5 * n + node->section->Hmin * n + 2 * n + 2 * n +
           3 * n * n;
}

static dse_real *take(dse_real **at, int count)
{
    dse_real *taken = *at;
    *at += count;
    return taken;
}

/* Entries of a list in the plant's order that belong to part i, on the diagonal of a matrix. */
static const dse_real *diagonal(dse_real **at, int count, const int *place, const double *list)
{
    if (list == NULL)
        return NULL;
    dse_real *matrix = take(at, count * count);
    for (int s = 0; s < count; s++)
        matrix[s * count + s] = (dse_real)list[place[s]];
    return matrix;
}

/* The same as a vector, less `offset` (may be NULL). */
static const dse_real *vector(dse_real **at, int count, const int *place, const double *list,
                              const dse_real *offset)
{
    if (list == NULL)
        return NULL;
    dse_real *made = take(at, count);
    for (int s = 0; s < count; s++) {
        double value = list[place[s]];
        double less = offset != NULL ? (double)offset[s] : 0;
        made[s] = fabs(value) >= UNBOUNDED ? (dse_real)(value > 0 ? INFINITY : -INFINITY)
                                           : (dse_real)(value - less);
    }
    return made;
}

static const dse_real *block(dse_real **at, const dse_real *matrix, int stride, int row, int rows,
                             int column, int columns)
{
    dse_real *made = take(at, rows * columns);
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < columns; c++)
            made[r * columns + c] = matrix[(row + r) * stride + column + c];
    return made;
}

static void fill_subsystem(struct coordinated_mhe_node *node, const struct method_setup *setup,
                           int i, dse_real **at)
{
    const struct coordinated_mhe_section *section = node->section;
    const struct coordinated_mhe_plant *plant = &node->plant;
    const int x = plant->first_state[i];
    const int y = plant->first_output[i];
    const int nx = coordinated_mhe_plant_nx(plant, i);
    const int ny = coordinated_mhe_plant_ny(plant, i);
    const int *state = plant->state + x;
    const dse_real *origin = plant->origin + x;
    const double *D = section->scheme == COORDINATED_MHE_PRICE ? section->D : NULL;
    node->subsystems[i] = (struct dse_mhe_subsystem){
        .nx = nx,
        .ny = ny,
        .A = block(at, plant->A, plant->n, x, nx, x, nx),
        .C = block(at, plant->C, plant->n, y, ny, x, nx),
        .Q = diagonal(at, nx, state, section->Q),
        .R = diagonal(at, ny, plant->output + y, section->R),
        .D = diagonal(at, nx, state, D),
        .prior = diagonal(at, nx, state, section->P_inv),
        .x0 = vector(at, nx, state, setup->network->guess, origin),
        .x_min = vector(at, nx, state, section->x_min, origin),
        .x_max = vector(at, nx, state, section->x_max, origin),
        .w_min = vector(at, nx, state, section->w_min, NULL),
        .w_max = vector(at, nx, state, section->w_max, NULL),
        .trigger = section->eps_i != NULL ? (dse_real)section->eps_i[i] : 0,
    };
}

/* The cost of interactions that the price-driven scheme has in addition (centralised-D). The
 * interactions are those between the plant's subsystems, whatever the parts are. */
static bool add_interaction_cost(struct coordinated_mhe_node *node,
                                 const struct method_setup *setup, dse_real **at,
                                 struct error *error)
{
    const struct coordinated_mhe_section *section = node->section;
    const int count = setup->process->n_subsystems;
    const int n = node->plant.n;
    if (section->scheme != COORDINATED_MHE_CENTRALISED || section->D == NULL)
        return true;
    struct dse_mhe_subsystem *parts = calloc((size_t)count, sizeof *parts);
    if (parts == NULL)
        return error_set(error, "out of memory");
    int first = 0;
    for (int i = 0; i < count; i++) {
        parts[i].nx = setup->process->subsystems[i].n_states;
        parts[i].D = diagonal(at, parts[i].nx, node->plant.state + first, section->D);
        first += parts[i].nx;
    }
    dse_real *cost = take(at, n * n);
    enum dse_status status = dse_mhe_interaction_cost(n, node->plant.A, count, parts, cost, *at);
    node->subsystems[0].stage_cost = cost;
    free(parts);
    return status == DSE_OK || error_set(error, "coordinated_mhe.D: %s", dse_status_text(status));
}

/* The coordinated schemes predict the first samples by the whole plant. */
static void fill_start(struct coordinated_mhe_node *node, const struct method_setup *setup,
                       dse_real **at)
{
    const int steps = (int)node->section->Hmin - 1;
    const int n = node->plant.n;
    if (!coordinated_mhe_is_coordinated(node->section) || setup->network->guess == NULL ||
        steps < 1 || coordinated_mhe_coordinates(node))
        return;
    const int nx = node->subsystems[node->part].nx;
    const dse_real *x0 =
        vector(at, n, node->plant.state, setup->network->guess, node->plant.origin);
    dse_real *start = take(at, steps * nx);
    dse_mhe_open_loop(n, node->plant.A, x0, steps, node->plant.first_state[node->part], nx, start,
                      *at);
    node->local_config.start = start;
}

bool coordinated_mhe_configure(struct coordinated_mhe_node *node, const struct method_setup *setup,
                               struct error *error)
{
    const struct coordinated_mhe_section *section = node->section;
    const struct coordinated_mhe_plant *plant = &node->plant;
    node->numbers = calloc(numbers_needed(node), sizeof *node->numbers);
    node->subsystems = calloc((size_t)plant->parts, sizeof *node->subsystems);
    if (node->numbers == NULL || node->subsystems == NULL)
        return error_set(error, "out of memory");
    dse_real *at = node->numbers;
    for (int i = 0; i < plant->parts; i++)
        fill_subsystem(node, setup, i, &at);
    node->settings = (struct dse_mhe_settings){
        .scheme = lib_schemes[section->scheme],
        .horizon = (int)section->Hp,
        .min_horizon = (int)section->Hmin,
        .barrier = (dse_real)section->t,
        .max_age = (int)(section->max_age > 0 ? section->max_age : section->Hp),
    };
    node->local_config.settings = &node->settings;
    node->local_config.subsystem =
        &node->subsystems[coordinated_mhe_coordinates(node) ? 0 : node->part];
    fill_start(node, setup, &at);
    node->coordinator_config = (struct dse_mhe_coordinator_config){
        .settings = &node->settings,
        .parts = plant->parts,
        .subsystems = node->subsystems,
        .A = plant->A,
        .eps = (dse_real)(section->eps > 0 ? section->eps : DEFAULT_EPS),
        .max_iter = (int)section->max_iter,
        .fixed_iterations = section->fixed_iter,
        .stop_on_any = section->stop_on_any,
        .price_start = section->price_start,
        .gradient_step = (dse_real)section->kappa,
        .recentrings = (int)section->recentrings,
        .shift = section->warm_start == COORDINATED_MHE_SHIFT,
        .consistent_certificate = (dse_real)section->rho_consistent,
        .relaxation = (dse_real)section->beta,
        .anderson = (int)section->anderson,
        .x_weight = vector(&at, plant->n, plant->state, section->x_weight, NULL),
        .p_weight = vector(&at, plant->n, plant->state, section->p_weight, NULL),
    };
    return add_interaction_cost(node, setup, &at, error);
}
