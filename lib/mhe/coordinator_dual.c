/* Coordinator of moving horizon estimators: how the dual function of the price-driven scheme bends.
 *
 * Agent i answers prices with X_i(p), linear where no active bound changes, and
 *
 *     -Hd = sum_i B_i' P_i^-1 B_i  (+ V in the blocks of i, where h_i is eliminated with W)
 *
 * P_i is block-tridiagonal and B_i has entries only in the columns of i and its neighbours: column
 * by column one solution with P_i's factor and products with single blocks of A. Two prices have
 * an entry in common only where some agent feels both: rows end with the farthest subsystem that is
 * two couplings away, and so do those of the factor. Only the upper triangle is made. */
#include <stddef.h>

#include "coordinator_internal.h"
#include "dse/linalg.h"

/* What differs with and without bounds: z = (x, w) or z = x, and what an agent's own price acts
 * on, through T: h = G x - w or T'G x - V p. */
struct shape {
    int nz;
    const dse_real *T; /* NULL: identity, and w is subtracted */
};

/* column <- B_i of price b of subsystem l at time t. */
static void fill_column(const struct dse_mhe_coordinator *c, int i, int l, int t, int b,
                        const struct shape *shape)
{
    const int nx = coordinator_nx(c, i), nz = shape->nz;
    dse_real *column = c->dual.column;
    for (int e = 0; e < c->length * nz; e++)
        column[e] = 0;
    dse_real *x = column + t * nz;
    if (l != i) { /* Th_i': -A_li' */
        dse_axpy(nx, -1, coordinator_block(c, l, i) + b * c->n, x);
        return;
    }
    const dse_real *A = c->config->subsystems[i].A;
    for (int a = 0; a < nx; a++) { /* G'T e_b, or G'e_b and -e_b on w */
        const dse_real v = shape->T ? shape->T[a * nx + b] : (dse_real)(a == b);
        dse_axpy(nx, -v, A + a * nx, x);
        x[nz + a] += v;
        if (!shape->T)
            x[nx + a] = -v;
    }
}

/* row += B_i' z for all columns of subsystem l. */
static void add_response(const struct dse_mhe_coordinator *c, int i, int l,
                         const struct shape *shape, const dse_real *z, dse_real *row)
{
    const int nx = coordinator_nx(c, i), nl = coordinator_nx(c, l), nz = shape->nz;
    const dse_real *A = c->config->subsystems[i].A;
    dse_real *v = c->dual.scratch;
    for (int t = 0; t < c->length - 1; t++) {
        const dse_real *x = z + t * nz;
        dse_real *out = row + (c->length - 1) * c->first[l] + t * nl;
        if (l != i) {
            const dse_real *block = coordinator_block(c, l, i);
            for (int b = 0; b < nl; b++)
                out[b] -= dse_dot(nx, block + b * c->n, x);
            continue;
        }
        for (int a = 0; a < nx; a++) /* G x (- w) */
            v[a] = x[nz + a] - dse_dot(nx, A + a * nx, x) - (shape->T ? 0 : x[nx + a]);
        for (int b = 0; b < nx; b++) {
            dse_real sum = shape->T ? 0 : v[b];
            for (int a = 0; a < nx && shape->T; a++)
                sum += shape->T[a * nx + b] * v[a];
            out[b] += sum;
        }
    }
}

/* Subsystem i itself (q < 0) and its neighbours, as far as they take part; -1: not. */
static int partner(const struct dse_mhe_coordinator *c, int i, int q)
{
    const int l = q < 0 ? i : c->neighbour[c->neighbour_first[i] + q];
    return coordinator_takes_part(c, l) ? l : -1;
}

/* matrix += B_i' P_i^-1 B_i, upper triangle of blocks, with the factor in dual.chain; fixed: marks
 * entries of z that an active bound holds, NULL: none. */
static void add_agent(struct dse_mhe_coordinator *c, int i, const struct shape *shape,
                      const dse_real *fixed, dse_real *matrix)
{
    const int m = (c->length - 1) * c->n, size = c->length * shape->nz;
    const int partners = c->neighbour_first[i + 1] - c->neighbour_first[i];
    dse_real *z = c->dual.column;
    for (int q = -1; q < partners; q++) {
        const int l = partner(c, i, q);
        for (int e = 0; l >= 0 && e < (c->length - 1) * coordinator_nx(c, l); e++) {
            const int nl = coordinator_nx(c, l);
            fill_column(c, i, l, e / nl, e % nl, shape);
            for (int k = 0; k < size && fixed; k++)
                z[k] = fixed[k] != 0 ? 0 : z[k];
            mhe_chain_solve(&c->dual.chain, z);
            dse_real *row = matrix + ((c->length - 1) * c->first[l] + e) * m;
            for (int r = -1; r < partners; r++)
                if (partner(c, i, r) >= l)
                    add_response(c, i, partner(c, i, r), shape, z, row);
        }
    }
}

/* dual.last: row e of subsystem i ends with the farthest one that feels what feels it, or where the
 * row before ends. */
static void find_envelope(struct dse_mhe_coordinator *c)
{
    const int transitions = c->length - 1;
    int farthest = 0;
    for (int i = 0; i < c->parts; i++) {
        farthest = i > farthest ? i : farthest;
        for (int q = c->neighbour_first[i]; q < c->neighbour_first[i + 1]; q++) {
            const int l = c->neighbour[q], end = c->neighbour_first[l + 1];
            const int beyond = c->neighbour[end - 1]; /* they ascend; i is one of them */
            farthest = l > farthest ? l : farthest;
            farthest = beyond > farthest ? beyond : farthest;
        }
        for (int e = transitions * c->first[i]; e < transitions * c->first[i + 1]; e++)
            c->dual.last[e] = transitions * c->first[farthest + 1] - 1;
    }
}

/* Zero from the diagonal block to the end of each row, and one on the diagonal for those who do not
 * take part. */
static void clear_matrix(const struct dse_mhe_coordinator *c, dse_real *matrix)
{
    const int transitions = c->length - 1, m = transitions * c->n;
    for (int i = 0; i < c->parts; i++) {
        const int from = transitions * c->first[i];
        for (int r = from; r < transitions * c->first[i + 1]; r++) {
            for (int e = from; e <= c->dual.last[r]; e++)
                matrix[r * m + e] = 0;
            matrix[r * m + r] = coordinator_takes_part(c, i) ? 0 : 1;
        }
    }
}

/* ---- without bounds ---- */

/* -Hd0 = sum_i B_i' M_x^-1 B_i + V,  B_i = Th_i' + G_i' T. */
static enum dse_status add_free_agent(struct dse_mhe_coordinator *c, int i)
{
    struct dse_mhe_dual *dual = &c->dual;
    const struct dse_mhe_subsystem *s = &c->config->subsystems[i];
    const int nx = s->nx, transitions = c->length - 1, m = transitions * c->n;
    enum dse_status status = mhe_outputs_set(&dual->outputs, s);
    if (status == DSE_OK)
        status = mhe_penalty_set(&dual->penalty, MHE_PENALTY_PRICE, s, dual->scratch);
    if (status != DSE_OK)
        return status;
    mhe_window_matrix(&dual->chain, c->length, &dual->outputs,
                      dual->has + c->length * c->first_output[i], &dual->penalty);
    status = mhe_chain_factor(&dual->chain);
    if (status != DSE_OK)
        return status;
    const struct shape shape = {.nz = nx, .T = dual->penalty.T};
    add_agent(c, i, &shape, NULL, dual->matrix);
    for (int t = 0; t < transitions; t++) {
        const int at = transitions * c->first[i] + t * nx;
        for (int a = 0; a < nx; a++)
            for (int b = 0; b < nx; b++)
                dual->matrix[(at + a) * m + at + b] += dual->penalty.V[a * nx + b];
    }
    return DSE_OK;
}

/* Whether the matrix at hand is that of the data and the agents of this round. */
static bool is_known(struct dse_mhe_coordinator *c)
{
    struct dse_mhe_dual *dual = &c->dual;
    const int outputs = c->length * c->ny;
    bool same = dual->known && dual->used_length == c->length;
    for (int i = 0; i < outputs + c->parts; i++) {
        const dse_real now =
            i < outputs ? dual->has[i] : (dse_real)coordinator_takes_part(c, i - outputs);
        same = same && dual->used[i] == now;
        dual->used[i] = now;
    }
    dual->used_length = c->length;
    return same;
}

enum dse_status coordinator_dual_free(struct dse_mhe_coordinator *c)
{
    struct dse_mhe_dual *dual = &c->dual;
    if (is_known(c))
        return DSE_OK;
    dual->known = false;
    find_envelope(c);
    clear_matrix(c, dual->matrix);
    enum dse_status status = DSE_OK;
    for (int i = 0; i < c->parts && status == DSE_OK; i++)
        if (coordinator_takes_part(c, i))
            status = add_free_agent(c, i);
    if (status == DSE_OK && !c->bounded)
        status =
            dse_envelope_cholesky((c->length - 1) * c->n, dual->last, dual->matrix, dual->matrix);
    dual->known = status == DSE_OK;
    return status;
}

/* ---- with active bounds ---- */

/* fixed (H nz): 1 where a bound holds an entry; rows and columns of those become the identity's. */
static void eliminate(struct dse_mhe_coordinator *c, int i, dse_real *fixed)
{
    struct dse_mhe_chain *P = &c->dual.chain;
    const int nx = coordinator_nx(c, i), nz = 2 * nx, H = c->length, size = nz * nz;
    const dse_real *bits = c->dual.bits + i * DSE_MHE_BIT_WORDS((2 * c->N - 1) * c->nx_max);
    const bool bounded = mhe_subsystem_is_bounded(&c->config->subsystems[i]);
    for (int k = 0; k < H * nz; k++) {
        const int t = k / nz, a = k % nz;
        const int bit = a < nx ? t * nx + a : H * nx + t * nx + a - nx;
        const bool exists = a < nx || t < H - 1;
        fixed[k] = bounded && exists && mhe_bit_get(bits, bit) ? 1 : 0;
        for (int b = 0; b < nz && fixed[k] != 0; b++) {
            P->D[t * size + a * nz + b] = P->D[t * size + b * nz + a] = (dse_real)(a == b);
            if (t < H - 1)
                P->U[t * size + a * nz + b] = 0;
            if (t > 0)
                P->U[(t - 1) * size + b * nz + a] = 0;
        }
    }
}

static enum dse_status add_active_agent(struct dse_mhe_coordinator *c, int i)
{
    struct dse_mhe_dual *dual = &c->dual;
    const struct dse_mhe_subsystem *s = &c->config->subsystems[i];
    enum dse_status status = mhe_outputs_set(&dual->outputs, s);
    if (status == DSE_OK)
        status = mhe_penalty_set(&dual->penalty, MHE_PENALTY_INTERACTION, s, dual->scratch);
    if (status == DSE_OK)
        status = mhe_penalty_set(&dual->disturbance, MHE_PENALTY_DISTURBANCE, s, dual->scratch);
    if (status != DSE_OK)
        return status;
    mhe_price_matrix(&dual->chain, c->length, &dual->outputs,
                     dual->has + c->length * c->first_output[i], &dual->disturbance,
                     &dual->penalty);
    eliminate(c, i, dual->response);
    status = mhe_chain_factor(&dual->chain);
    const struct shape shape = {.nz = 2 * s->nx, .T = NULL};
    if (status == DSE_OK)
        add_agent(c, i, &shape, dual->response, dual->active);
    return status;
}

enum dse_status coordinator_dual_active(struct dse_mhe_coordinator *c)
{
    clear_matrix(c, c->dual.active);
    enum dse_status status = DSE_OK;
    for (int i = 0; i < c->parts && status == DSE_OK; i++)
        if (coordinator_takes_part(c, i))
            status = add_active_agent(c, i);
    return status;
}
