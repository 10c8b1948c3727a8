/* Coordinated moving horizon estimation: what follows from a subsystem's data. */
#include <stddef.h>

#include "coordinated_internal.h"
#include "dse/linalg.h"
#include "dse/math.h"

/* ---- checks ---- */

static bool bounds_fit(int n, const dse_real *lower, const dse_real *upper)
{
    for (int i = 0; i < n; i++) {
        const dse_real low = lower ? lower[i] : -DSE_REAL_MAX;
        const dse_real high = upper ? upper[i] : DSE_REAL_MAX;
        if (!(low <= high)) /* also NaN */
            return false;
    }
    return true;
}

enum dse_status mhe_subsystem_check(const struct dse_mhe_subsystem *s)
{
    if (s->nx < 1 || s->ny < 1 || !s->A || !s->C || !s->Q || !s->R)
        return DSE_EINVAL;
    if (!bounds_fit(s->nx, s->x_min, s->x_max) || !bounds_fit(s->nx, s->w_min, s->w_max))
        return DSE_EINVAL;
    if (!(s->trigger >= 0) || !dse_is_finite(s->trigger))
        return DSE_EINVAL;
    if (!dse_all_finite(s->A, s->nx * s->nx) || !dse_all_finite(s->C, s->ny * s->nx) ||
        (s->x0 && !dse_all_finite(s->x0, s->nx)))
        return DSE_ENONFINITE;
    const dse_real *weights[] = {s->Q, s->D, s->prior, s->stage_cost};
    for (int i = 0; i < 4; i++) {
        const enum dse_status status = weights[i] ? dse_sym_check(s->nx, weights[i]) : DSE_OK;
        if (status != DSE_OK)
            return status;
    }
    return dse_sym_check(s->ny, s->R);
}

bool mhe_subsystem_is_bounded(const struct dse_mhe_subsystem *s)
{
    return s->x_min || s->x_max || s->w_min || s->w_max;
}

enum dse_status mhe_settings_check(const struct dse_mhe_settings *settings)
{
    if (settings->scheme != DSE_MHE_ALONE && settings->scheme != DSE_MHE_PRICE &&
        settings->scheme != DSE_MHE_PREDICTION)
        return DSE_EINVAL;
    if (settings->horizon < 1 || settings->min_horizon < 1 ||
        settings->min_horizon > settings->horizon || settings->max_age < 0)
        return DSE_EINVAL;
    if (!(settings->barrier >= 0) || !dse_is_finite(settings->barrier))
        return DSE_EINVAL;
    return settings->barrier > 0 && settings->scheme == DSE_MHE_PRICE ? DSE_EINVAL : DSE_OK;
}

/* ---- outputs ---- */

void mhe_outputs_take(struct dse_mhe_outputs *outputs, int nx, int ny, struct dse_arena *arena)
{
    outputs->L = dse_arena_take(arena, ny * ny);
    outputs->L_partial = dse_arena_take(arena, ny * ny);
    outputs->rows = dse_arena_take(arena, ny * nx);
    outputs->partial = dse_arena_take(arena, ny * nx);
    outputs->white = dse_arena_take(arena, ny);
}

enum dse_status mhe_outputs_set(struct dse_mhe_outputs *outputs, const struct dse_mhe_subsystem *s)
{
    outputs->subsystem = s;
    const enum dse_status status = dse_cholesky(s->ny, s->R, outputs->L);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < s->ny * s->nx; i++)
        outputs->rows[i] = s->C[i];
    dse_lower_solve(s->ny, outputs->L, s->nx, outputs->rows);
    return DSE_OK;
}

/* Rows L^-1 C and the factor L of the channels that there are; the others get rows of zeros and a
 * noise of variance 1 of their own. */
static const dse_real *whiten(struct dse_mhe_outputs *outputs, const dse_real *has,
                              const dse_real **L)
{
    const struct dse_mhe_subsystem *s = outputs->subsystem;
    const int nx = s->nx, ny = s->ny;
    bool complete = true;
    for (int i = 0; i < ny; i++)
        complete = complete && has[i] != 0;
    *L = complete ? outputs->L : outputs->L_partial;
    if (complete)
        return outputs->rows;
    dse_real *part = outputs->L_partial;
    for (int i = 0; i < ny; i++) {
        for (int j = 0; j < ny; j++)
            part[i * ny + j] = has[i] != 0 && has[j] != 0 ? s->R[i * ny + j] : (dse_real)(i == j);
        for (int j = 0; j < nx; j++)
            outputs->partial[i * nx + j] = has[i] != 0 ? s->C[i * nx + j] : 0;
    }
    (void)dse_cholesky(ny, part, part); /* a principal part of R, which has a factor */
    dse_lower_solve(ny, part, nx, outputs->partial);
    return outputs->partial;
}

void mhe_outputs_add(struct dse_mhe_outputs *outputs, const dse_real *has, int stride, dse_real *M)
{
    const int nx = outputs->subsystem->nx, ny = outputs->subsystem->ny;
    const dse_real *L;
    const dse_real *rows = whiten(outputs, has, &L);
    for (int j = 0; j < ny; j++)
        for (int i = 0; i < nx; i++)
            dse_axpy(nx, rows[j * nx + i], rows + j * nx, M + i * stride);
}

void mhe_outputs_project(struct dse_mhe_outputs *outputs, const dse_real *has, const dse_real *y,
                         dse_real *c)
{
    const int ny = outputs->subsystem->ny;
    const dse_real *L;
    const dse_real *rows = whiten(outputs, has, &L);
    for (int j = 0; j < ny; j++)
        outputs->white[j] = has[j] != 0 ? y[j] : 0;
    dse_lower_solve(ny, L, 1, outputs->white);
    dse_mat_tvec(ny, outputs->subsystem->nx, rows, outputs->white, c);
}

void mhe_outputs_apply(struct dse_mhe_outputs *outputs, const dse_real *has, const dse_real *x,
                       dse_real *z)
{
    const int nx = outputs->subsystem->nx, ny = outputs->subsystem->ny;
    const dse_real *L;
    const dse_real *rows = whiten(outputs, has, &L);
    dse_mat_vec(ny, nx, rows, x, outputs->white);
    dse_mat_tvec(ny, nx, rows, outputs->white, z);
}

/* ---- penalties ---- */

enum dse_status mhe_inverse(int n, const dse_real *A, dse_real *B, dse_real *scratch)
{
    const enum dse_status status = dse_cholesky(n, A, scratch);
    if (status != DSE_OK)
        return status;
    dse_mat_identity(n, B);
    dse_cholesky_solve(n, scratch, n, B);
    dse_sym_enforce(n, B);
    return DSE_OK;
}

/* S = (Q + D)^-1, T = S D, V = Q T; without D, which is D without limit: S = 0, T = I, V = Q. */
static enum dse_status fill_price(struct dse_mhe_penalty *penalty,
                                  const struct dse_mhe_subsystem *s, dse_real *scratch)
{
    const int nx = s->nx, size = nx * nx;
    if (s->D) {
        dse_real *sum = scratch + size;
        for (int e = 0; e < size; e++)
            sum[e] = s->Q[e] + s->D[e];
        enum dse_status status = dse_cholesky(nx, s->D, scratch); /* the sum may hide a wrong D */
        if (status == DSE_OK)
            status = mhe_inverse(nx, sum, penalty->S, scratch);
        if (status != DSE_OK)
            return status;
        dse_mat_mul(nx, nx, nx, penalty->S, s->D, penalty->T);
    } else {
        dse_mat_identity(nx, penalty->T);
    }
    dse_mat_mul(nx, nx, nx, s->Q, penalty->T, penalty->V);
    dse_sym_enforce(nx, penalty->V); /* (Q^-1 + D^-1)^-1 */
    return DSE_OK;
}

/* D^-1, or zero without D. */
static enum dse_status fill_interaction(struct dse_mhe_penalty *penalty,
                                        const struct dse_mhe_subsystem *s, dse_real *scratch)
{
    return s->D ? mhe_inverse(s->nx, s->D, penalty->S, scratch) : DSE_OK;
}

void mhe_penalty_take(struct dse_mhe_penalty *penalty, int nx, struct dse_arena *arena)
{
    penalty->S = dse_arena_take(arena, nx * nx);
    penalty->AtS = dse_arena_take(arena, nx * nx);
    penalty->AtSA = dse_arena_take(arena, nx * nx);
    penalty->T = dse_arena_take(arena, nx * nx);
    penalty->V = dse_arena_take(arena, nx * nx);
}

enum dse_status mhe_penalty_set(struct dse_mhe_penalty *penalty, enum mhe_penalty_kind kind,
                                const struct dse_mhe_subsystem *s, dse_real *scratch)
{
    const int nx = s->nx;
    for (int e = 0; e < nx * nx; e++)
        penalty->S[e] = 0;
    enum dse_status status;
    if (kind == MHE_PENALTY_PRICE)
        status = fill_price(penalty, s, scratch);
    else if (kind == MHE_PENALTY_INTERACTION)
        status = fill_interaction(penalty, s, scratch);
    else
        status = mhe_inverse(nx, s->Q, penalty->S, scratch);
    if (status != DSE_OK)
        return status;
    dse_mat_mul_tn(nx, nx, nx, s->A, penalty->S, penalty->AtS);
    dse_mat_mul(nx, nx, nx, penalty->AtS, s->A, penalty->AtSA);
    dse_sym_enforce(nx, penalty->AtSA);
    return DSE_OK;
}

/* ---- windows ---- */

static void add(int count, const dse_real *a, dse_real *b)
{
    for (int i = 0; i < count && a; i++)
        b[i] += a[i];
}

void mhe_window_matrix(struct dse_mhe_chain *chain, int length, struct dse_mhe_outputs *outputs,
                       const dse_real *has, const struct dse_mhe_penalty *penalty)
{
    const struct dse_mhe_subsystem *s = outputs->subsystem;
    const int nx = s->nx, size = nx * nx;
    chain->n = nx;
    chain->length = length;
    for (int t = 0; t < length; t++) {
        dse_real *D = chain->D + t * size;
        for (int e = 0; e < size; e++)
            D[e] = 0;
        mhe_outputs_add(outputs, has + t * s->ny, nx, D);
        add(size, t == 0 ? s->prior : penalty->S, D);
        if (t == length - 1)
            break;
        add(size, penalty->AtSA, D);
        add(size, s->stage_cost, D);
        for (int e = 0; e < size; e++)
            chain->U[t * size + e] = -penalty->AtS[e];
    }
}

void mhe_differences(const struct dse_mhe_subsystem *s, int length, const dse_real *X, dse_real *y)
{
    for (int t = 0; t < length - 1; t++) {
        const dse_real *x = X + t * s->nx;
        for (int i = 0; i < s->nx; i++)
            y[t * s->nx + i] = x[s->nx + i] - dse_dot(s->nx, s->A + i * s->nx, x);
    }
}

void mhe_differences_transposed(const struct dse_mhe_subsystem *s, int length, dse_real a,
                                const dse_real *v, dse_real *x)
{
    const int nx = s->nx;
    for (int t = 0; t < length - 1; t++) {
        const dse_real *vt = v + t * nx;
        for (int i = 0; i < nx; i++)
            dse_axpy(nx, -a * vt[i], s->A + i * nx, x + t * nx);
        dse_axpy(nx, a, vt, x + (t + 1) * nx);
    }
}

/* D_t = [M_t + A'D^-1A (+ D^-1)   A'D^-1 ]   U_t = [-A'D^-1  0]
 *       [D^-1A            Q^-1 + D^-1    ]         [  -D^-1  0]     z_t = (x_t, w_t) */
void mhe_price_matrix(struct dse_mhe_chain *chain, int length, struct dse_mhe_outputs *outputs,
                      const dse_real *has, const struct dse_mhe_penalty *disturbance,
                      const struct dse_mhe_penalty *interaction)
{
    const struct dse_mhe_subsystem *s = outputs->subsystem;
    const int nx = s->nx, nz = 2 * nx;
    chain->n = nz;
    chain->length = length;
    for (int t = 0; t < length; t++) {
        dse_real *D = chain->D + t * nz * nz, *U = chain->U + t * nz * nz;
        for (int e = 0; e < nz * nz; e++)
            D[e] = 0;
        mhe_outputs_add(outputs, has + t * s->ny, nz, D);
        for (int i = 0; i < nx; i++) {
            const int w = nx + i;
            add(nx, t == 0 ? (s->prior ? s->prior + i * nx : NULL) : interaction->S + i * nx,
                D + i * nz);
            if (t == length - 1) {
                D[w * nz + w] = 1; /* there is no w of the newest sample */
                continue;
            }
            add(nx, interaction->AtSA + i * nx, D + i * nz);
            add(nx, interaction->AtS + i * nx, D + i * nz + nx);
            add(nx, disturbance->S + i * nx, D + w * nz + nx);
            add(nx, interaction->S + i * nx, D + w * nz + nx);
            for (int j = 0; j < nx; j++) {
                D[w * nz + j] = interaction->AtS[j * nx + i];
                U[i * nz + j] = -interaction->AtS[i * nx + j];
                U[w * nz + j] = -interaction->S[i * nx + j];
                U[i * nz + nx + j] = U[w * nz + nx + j] = 0;
            }
        }
    }
}
