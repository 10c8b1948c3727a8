/* From the reference's matrices to a network of observers. The reference works with y1, y2 (or yt)
 * that hold the constraint rows -B1 u before the measurements; the library with raw y and u. */
#include <stdlib.h>
#include <string.h>

#include "../golden.h"
#include "dse/linalg.h"
#include "parts.h"

/* A matrix of the reference, row by row, from row and column `from` on. */
static void fetch(const json_t *node, const char *key, int rows, int columns, int from_row,
                  int from_column, double *out)
{
    const json_t *all = json_object_get(node, key);
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++)
            out[i * columns + j] =
                json_number_value(json_array_get(json_array_get(all, (size_t)from_row + (size_t)i),
                                                 (size_t)from_column + (size_t)j));
}

static void add_scaled(int n, double a, const double *x, double *y)
{
    for (int i = 0; i < n; i++)
        y[i] += a * x[i];
}

/* Reduced order: s = 0, R = I, one constraint row x4 = -u1, so that y2 = (-B1 u, y*). */
static void uio(const json_t *node, struct matrices *m, struct dse_distributed_observer_config *c)
{
    double L2[3], N[4 * 3], B1[2];
    fetch(node, "Lam", 1, 1, 0, 0, m->Lambda);
    fetch(node, "L2", 1, 3, 0, 0, L2);
    fetch(node, "N", 4, 3, 0, 0, N);
    fetch(node, "B1", 1, 2, 0, 0, B1);
    fetch(node, "H", 1, 2, 0, 0, m->H);
    fetch(node, "M", 4, 1, 0, 0, m->M);
    fetch(node, "Pi_U1", 1, 1, 0, 0, m->Pi);
    fetch(node, "C2", 3, 4, 0, 0, m->C2);
    fetch(node, "C", 2, 4, 1, 0, m->C);
    fetch(node, "D", 3, 1, 0, 0, m->D);
    memcpy(m->L, L2 + 1, 2 * sizeof *L2);
    add_scaled(2, -L2[0], B1, m->H);
    memset(m->J, 0, sizeof m->J);
    for (int i = 0; i < 4; i++) {
        memcpy(m->N + 2 * i, N + 3 * i + 1, 2 * sizeof *N);
        add_scaled(2, -N[3 * i], B1, m->J + 2 * i);
    }
    const double minus_y2[3 * 2] = {0, 0, -1, 0, 0, -1}; /* r = D z - y2 */
    memcpy(m->D_y, minus_y2, sizeof minus_y2);
    memset(m->D_u, 0, sizeof m->D_u);
    memcpy(m->D_u, B1, sizeof B1);
    c->nz = 1;
    c->nx = 4;
    c->nr = 3;
}

/* yt = (-Ep B u, y) with Ep B = [1 1; 0 0]. consistent: r = zh - W yt; else r = D'zh - y. */
static void fo(const json_t *node, bool consistent, struct matrices *m,
               struct dse_distributed_observer_config *c)
{
    const double EpB[2] = {1, 1};
    double J[4], Q[4], D[2], W[4];
    fetch(node, "N", 1, 1, 0, 0, m->Lambda);
    fetch(node, "J", 1, 4, 0, 0, J);
    fetch(node, "H", 1, 2, 0, 0, m->H);
    fetch(node, "M", 1, 1, 0, 0, m->M);
    fetch(node, "Q", 1, 4, 0, 0, Q);
    fetch(node, "D", 1, 2, 0, 0, D);
    fetch(node, "W", 1, 4, 0, 0, W);
    fetch(node, "Pi_U1", 1, 1, 0, 0, m->Pi);
    fetch(node, "Ct", 2, 4, 2, 0, m->C);
    memcpy(m->L, J + 2, 2 * sizeof *J);
    memcpy(m->N, Q + 2, 2 * sizeof *Q);
    add_scaled(2, -J[0], EpB, m->H);
    for (int k = 0; k < 2; k++)
        m->J[k] = -Q[0] * EpB[k];
    c->nz = c->nx = 1;
    c->nr = consistent ? 1 : 2;
    for (int i = 0; i < c->nr; i++) {
        const double S = consistent ? 1 : D[i];
        m->C2[i] = S;
        m->D[i] = S * m->M[0];
        for (int k = 0; k < 2; k++) {
            m->D_y[2 * i + k] = S * m->N[k] - (consistent ? W[2 + k] : i == k);
            m->D_u[2 * i + k] = S * m->J[k] + (consistent ? W[0] * EpB[k] : 0);
        }
    }
}

/* r = C xh - y, xh = z + J y */
static void uio_full_order(const json_t *node, struct matrices *m,
                           struct dse_distributed_observer_config *c)
{
    double CJ[2 * 2];
    fetch(node, "Ao", 3, 3, 0, 0, m->Lambda);
    fetch(node, "L", 3, 2, 0, 0, m->L);
    fetch(node, "H", 3, 2, 0, 0, m->H);
    fetch(node, "J", 3, 2, 0, 0, m->N);
    fetch(node, "Pi_U1", 3, 3, 0, 0, m->Pi);
    fetch(node, "C", 2, 3, 0, 0, m->C);
    dse_mat_identity(3, m->M);
    memset(m->J, 0, sizeof m->J);
    memcpy(m->D, m->C, 2 * 3 * sizeof *m->C);
    dse_mat_mul(2, 3, 2, m->C, m->N, CJ);
    for (int i = 0; i < 4; i++)
        m->D_y[i] = CJ[i] - (i % 3 == 0);
    memset(m->D_u, 0, sizeof m->D_u);
    c->nz = c->nx = 3;
    c->nr = 2;
}

/* r = D'zh - y, zh = zeta + Q y */
static void fo_full_order(const json_t *node, struct matrices *m,
                          struct dse_distributed_observer_config *c)
{
    fetch(node, "N", 1, 1, 0, 0, m->Lambda);
    fetch(node, "J", 1, 2, 0, 0, m->L);
    fetch(node, "H", 1, 2, 0, 0, m->H);
    fetch(node, "Q", 1, 2, 0, 0, m->N);
    fetch(node, "D", 1, 2, 0, 0, m->C2);
    fetch(node, "Pi_U1", 1, 1, 0, 0, m->Pi);
    fetch(node, "C", 2, 4, 0, 0, m->C);
    m->M[0] = 1;
    memset(m->J, 0, sizeof m->J);
    memset(m->D_u, 0, sizeof m->D_u);
    for (int i = 0; i < 2; i++) {
        m->D[i] = m->C2[i];
        for (int k = 0; k < 2; k++)
            m->D_y[2 * i + k] = m->C2[i] * m->N[k] - (i == k);
    }
    c->nz = c->nx = 1;
    c->nr = 2;
}

static void use(struct dse_distributed_observer_config *c, const struct matrices *m)
{
    c->nu = c->ny = RIG_OUTPUTS;
    c->Lambda = m->Lambda;
    c->L = m->L;
    c->H = m->H;
    c->M = m->M;
    c->N = m->N;
    c->J = m->J;
    c->z0 = m->z0;
    c->Pi = m->Pi;
    c->D = m->D;
    c->D_y = m->D_y;
    c->D_u = m->D_u;
}

/* The law's settings; compare: whether estimates are compared in C2 only. */
static bool choose_law(const char *kind, const char *law, const char *mode, double gamma,
                       struct dse_distributed_observer_config *c, bool *compare)
{
    const bool functional = strncmp(kind, "fo", 2) == 0, consistent = !strcmp(law, "consistent");
    c->gamma = gamma;
    c->leak = strcmp(law, "leak") == 0 ? gamma : 0;
    c->gain = strcmp(mode, "node") == 0 ? DSE_OBSERVER_NODE : DSE_OBSERVER_EDGE;
    c->residual = consistent && !functional ? DSE_OBSERVER_NEIGHBOURS : DSE_OBSERVER_OWN;
    *compare = functional || consistent || strcmp(law, "c2") == 0 || strcmp(law, "leak") == 0;
    return consistent || *compare || strcmp(law, "thesis") == 0 || strcmp(law, "full") == 0;
}

static const struct rig_plant *fill(const char *kind, const char *law, const json_t *node,
                                    struct matrices *m, struct dse_distributed_observer_config *c,
                                    const double **functional)
{
    static const double third[4] = {0, 0, 1, 0}, second_and_third[4] = {0, 1, 1, 0};
    *functional = NULL;
    if (strcmp(kind, "uio") == 0) {
        uio(node, m, c);
        return &rig_descriptor_uio;
    }
    if (strcmp(kind, "fo") == 0) {
        fo(node, strcmp(law, "consistent") == 0, m, c);
        *functional = third;
        return &rig_descriptor_fo;
    }
    if (strcmp(kind, "uio_fullorder") == 0) {
        uio_full_order(node, m, c);
        return &rig_full_order_uio;
    }
    if (strcmp(kind, "fo_fullorder") == 0) {
        fo_full_order(node, m, c);
        *functional = second_and_third;
        return &rig_full_order_fo;
    }
    return NULL;
}

bool make_network(struct rig *rig, struct matrices *store, const json_t *root, const json_t *run,
                  const double **functional)
{
    const char *kind = json_string_value(json_object_get(root, "kind"));
    const char *law = json_string_value(json_object_get(run, "law"));
    const char *mode = json_string_value(json_object_get(run, "mode"));
    const json_t *design = json_object_get(root, "design"), *z0 = json_object_get(root, "z0");
    const json_t *list = json_object_get(run, "edges");
    const double *C2[RIG_NODES] = {NULL};
    int edge[RIG_NODES * RIG_DEGREE][2], rows[RIG_NODES];
    const int edges = (int)json_array_size(list);
    rig->n = (int)json_array_size(design);
    if (kind == NULL || law == NULL || mode == NULL || rig->n < 1 || rig->n > RIG_NODES ||
        edges > RIG_NODES * RIG_DEGREE)
        return false;
    const double gamma = golden_number(run, "gamma", golden_number(root, "gamma", 0));
    for (int i = 0; i < rig->n; i++) {
        bool compare;
        rig->config[i] = (struct dse_distributed_observer_config){0};
        rig->plant = fill(kind, law, json_array_get(design, (size_t)i), &store[i], &rig->config[i],
                          functional);
        if (rig->plant == NULL || !choose_law(kind, law, mode, gamma, &rig->config[i], &compare))
            return false;
        use(&rig->config[i], &store[i]);
        rig->C[i] = store[i].C;
        C2[i] = compare ? store[i].C2 : NULL;
        rows[i] = rig->config[i].nr;
        int count;
        double *numbers = golden_numbers(z0, &count);
        memcpy(store[i].z0, numbers + i * rig->config[i].nz,
               (size_t)rig->config[i].nz * sizeof *numbers);
        free(numbers);
    }
    for (int e = 0; e < edges; e++)
        for (int end = 0; end < 2; end++)
            edge[e][end] = (int)json_integer_value(
                json_array_get(json_array_get(list, (size_t)e), (size_t)end));
    rig_connect(rig, edges, (const int(*)[2])edge, C2, rows);
    return true;
}
