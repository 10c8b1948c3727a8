/* Linear moving horizon estimator: samples come, slide and leave. */
#include <stddef.h>

#include "dse/linalg.h"
#include "dse/linear_mhe.h"
#include "dse/math.h"
#include "linear_mhe_internal.h"

bool linear_mhe_has_data(const struct dse_linear_mhe *mhe, int place)
{
    for (int j = 0; j < mhe->ny; j++)
        if (mhe->has[place * mhe->ny + j] != 0)
            return true;
    return false;
}

const dse_real *linear_mhe_rows(const struct dse_linear_mhe *mhe, int place)
{
    return linear_mhe_is_complete(mhe, place) ? mhe->E : mhe->rows + place * mhe->ny * mhe->nx;
}

void linear_mhe_move(const struct dse_linear_mhe *mhe, const dse_real *x, const dse_real *b,
                     dse_real *next)
{
    dse_mat_vec(mhe->nx, mhe->nx, mhe->config->linear.A, x, next);
    dse_axpy(mhe->nx, 1, b, next);
}

/* L^-1 C and L^-1 (y - D u) of the channels that there are: the others get zero rows and a noise of
 * their own, of variance 1 and independent of the rest. */
static enum dse_status whiten_part(struct dse_linear_mhe *mhe, int place)
{
    const int nx = mhe->nx, ny = mhe->ny;
    const dse_real *has = mhe->has + place * ny, *R = mhe->config->R, *C = mhe->config->linear.C;
    dse_real *L = mhe->scratch, *rows = mhe->rows + place * ny * nx;
    for (int i = 0; i < ny; i++) {
        for (int j = 0; j < ny; j++)
            L[i * ny + j] = has[i] != 0 && has[j] != 0 ? R[i * ny + j] : (dse_real)(i == j);
        for (int j = 0; j < nx; j++)
            rows[i * nx + j] = has[i] != 0 ? C[i * nx + j] : 0;
    }
    const enum dse_status status = dse_cholesky(ny, L, L);
    if (status != DSE_OK)
        return status; /* cannot be: it is a part of R, which has a factor */
    dse_lower_solve(ny, L, nx, rows);
    dse_lower_solve(ny, L, 1, mhe->white + place * ny);
    return DSE_OK;
}

/* What the solution needs to know of a sample: rows, white, and c = C' R^-1 (y - D u). */
static enum dse_status whiten(struct dse_linear_mhe *mhe, int place)
{
    const int ny = mhe->ny;
    dse_real *white = mhe->white + place * ny;
    for (int j = 0; j < ny; j++)
        white[j] = mhe->y[place * ny + j];
    enum dse_status status = DSE_OK;
    if (linear_mhe_is_complete(mhe, place))
        dse_lower_solve(ny, mhe->L, 1, white);
    else
        status = whiten_part(mhe, place);
    dse_mat_tvec(ny, mhe->nx, linear_mhe_rows(mhe, place), white, mhe->c + place * mhe->nx);
    return status;
}

static void empty(struct dse_linear_mhe *mhe, int place)
{
    const int nx = mhe->nx, ny = mhe->ny;
    for (int j = 0; j < ny; j++) {
        mhe->y[place * ny + j] = 0;
        mhe->has[place * ny + j] = 0;
        mhe->white[place * ny + j] = 0;
    }
    for (int i = 0; i < ny * nx; i++)
        mhe->rows[place * ny * nx + i] = 0;
    for (int i = 0; i < nx; i++)
        mhe->c[place * nx + i] = 0;
    mhe->incomplete++;
}

/* The newest estimate for the record of the arrival cost: of the last solution, or, when that is
 * older, moved on from the estimate of the sample before. */
static void keep_newest(struct dse_linear_mhe *mhe)
{
    const int nx = mhe->nx, place = mhe->newest_place;
    dse_real *past = mhe->past + place * nx;
    if (mhe->solved_length > 0 && mhe->solved_newest == mhe->newest) {
        for (int i = 0; i < nx; i++)
            past[i] = dse_linear_mhe_state(mhe)[i];
    } else if (mhe->newest == 0) {
        for (int i = 0; i < nx; i++)
            past[i] = mhe->xbar[i];
    } else {
        const int before = place > 0 ? place - 1 : mhe->N - 1;
        for (int i = 0; i < nx; i++)
            mhe->scratch[i] = mhe->past[before * nx + i];
        linear_mhe_move(mhe, mhe->scratch, mhe->b + place * nx, past);
    }
}

enum dse_status dse_linear_mhe_advance(struct dse_linear_mhe *mhe, const dse_real *u)
{
    const int nx = mhe->nx, nu = mhe->nu, N = mhe->N;
    if (nu > 0 && !u)
        return DSE_EINVAL;
    if (nu > 0 && !dse_all_finite(u, nu))
        return DSE_ENONFINITE;
    /* The place of the new sample is that of the one that leaves; b is held beside it until then.
     */
    dse_real *drive = mhe->residual;
    for (int i = 0; i < nx; i++)
        drive[i] = nu > 0 ? dse_dot(nu, mhe->config->linear.B + i * nu, u) : 0;
    if (!dse_all_finite(drive, nx))
        return DSE_ENONFINITE;
    keep_newest(mhe);
    if (mhe->length == N) {
        const int oldest = linear_mhe_place(mhe, 0), second = linear_mhe_place(mhe, N > 1);
        const enum dse_status status =
            linear_mhe_arrive(mhe, oldest == second ? drive : mhe->b + second * nx);
        if (status != DSE_OK)
            return status;
        mhe->incomplete -= !linear_mhe_is_complete(mhe, oldest);
    } else {
        mhe->length++;
    }
    mhe->newest++;
    const int place = mhe->newest_place + 1 < N ? mhe->newest_place + 1 : 0;
    mhe->newest_place = place;
    empty(mhe, place);
    for (int i = 0; i < nx; i++)
        mhe->b[place * nx + i] = drive[i];
    return DSE_OK;
}

/* Takes the values of a sample; how many. */
static int take_values(struct dse_linear_mhe *mhe, int place, bool late, const dse_real *u,
                       const struct dse_measurement *measurement)
{
    const int nu = mhe->nu;
    const dse_real *D = mhe->config->linear.D;
    struct dse_linear_mhe_counts *counts = &mhe->counts;
    int taken = 0;
    for (int j = 0; j < mhe->ny; j++) {
        const int k = place * mhe->ny + j;
        if (measurement->valid && !measurement->valid[j]) {
            counts->missing++;
            continue;
        }
        const dse_real direct = D && nu > 0 ? dse_dot(nu, D + j * nu, u) : 0;
        const dse_real value = measurement->y[j] - direct;
        if (!dse_is_finite(value)) {
            counts->nonfinite++;
            continue;
        }
        counts->replaced += mhe->has[k] != 0;
        mhe->y[k] = value;
        mhe->has[k] = 1;
        taken++;
    }
    counts->used += taken;
    counts->late += late ? taken : 0;
    return taken;
}

enum dse_status dse_linear_mhe_measure(struct dse_linear_mhe *mhe, int age, const dse_real *u,
                                       const struct dse_measurement *measurement)
{
    const bool direct = mhe->config->linear.D != NULL && mhe->nu > 0;
    if (age < 0 || !measurement || (direct && !u))
        return DSE_EINVAL;
    if (age >= mhe->length) {
        mhe->counts.outdated++;
        return DSE_ENODATA;
    }
    if (direct && !dse_all_finite(u, mhe->nu))
        return DSE_ENONFINITE;
    const int place = linear_mhe_place(mhe, mhe->length - 1 - age);
    const bool was_complete = linear_mhe_is_complete(mhe, place);
    if (take_values(mhe, place, age > 0, u, measurement) == 0)
        return DSE_OK;
    mhe->incomplete -= !was_complete && linear_mhe_is_complete(mhe, place);
    return whiten(mhe, place);
}
