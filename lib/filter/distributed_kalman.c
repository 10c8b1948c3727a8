/* Distributed Kalman filter: a sample's passage through a node, and what can be read of it. */
#include "dse/distributed_kalman.h"

#include "distributed_kalman_internal.h"
#include "dse/math.h"

enum dse_status dkf_plant(const struct dse_dkf *dkf, dse_real t, const dse_real *x, dse_real *A,
                          dse_real *dx)
{
    const struct dse_model *model = dkf->config->model;
    if (dkf->riccati || dkf->lyapunov || model->f == NULL) {
        const enum dse_status status = model->dfdx(model, t, x, dkf->u, A);
        if (status != DSE_OK)
            return status;
    }
    if (model->f != NULL)
        return model->f(model, t, x, dkf->u, dx);
    dkf_apply(dkf->nx, dkf->nx, A, x, dx);
    return DSE_OK;
}

/* The inverse of R with the rows and columns of missing channels replaced by those of the identity;
 * then those are put to zero. */
enum dse_status dkf_invert_noise(int ny, const dse_real *R, const dse_real *has, dse_real *inverse,
                                 dse_real *scratch)
{
    for (int r = 0; r < ny; r++) {
        for (int c = 0; c < ny; c++) {
            const bool both = has[r] != 0 && has[c] != 0;
            scratch[r * ny + c] = both ? R[r * ny + c] : (dse_real)(r == c);
            inverse[r * ny + c] = both ? (dse_real)(r == c) : 0;
        }
    }
    const enum dse_status status = dse_cholesky(ny, scratch, scratch);
    if (status == DSE_OK)
        dse_cholesky_solve(ny, scratch, ny, inverse);
    return status;
}

/* ---- a sample ---- */

static enum dse_status take_channels(struct dse_dkf *dkf, const struct dse_measurement *measurement)
{
    const int m = dkf->ny;
    dkf->present = 0;
    for (int l = 0; l < m; l++) {
        const bool flagged = measurement->valid == NULL || measurement->valid[l];
        const bool has = dse_measurement_has(measurement, l);
        dkf->has[l] = (dse_real)has;
        dkf->y[l] = has ? measurement->y[l] : 0;
        dkf->present += has;
        dkf->counts.missing += !flagged;
        dkf->counts.nonfinite += flagged && !has;
    }
    dkf->counts.used += dkf->present;
    if (dkf->discrete || !dkf->riccati)
        return DSE_OK;
    if (dkf->present < m)
        return dkf_invert_noise(m, dkf->config->R, dkf->has, dkf->R_present, dkf->scratch);
    for (int k = 0; k < m * m; k++)
        dkf->R_present[k] = dkf->R_inverse[k];
    return DSE_OK;
}

enum dse_status dse_dkf_begin(struct dse_dkf *dkf, dse_real t, const dse_real *u,
                              const struct dse_measurement *measurement)
{
    if (!dse_is_finite(t))
        return DSE_EINVAL;
    dkf->t = t;
    dkf->u = u;
    dkf->corrected = false;
    dkf->refused = false;
    dkf->has_global = false;
    for (int j = 0; j < dkf->config->n_neighbours; j++)
        if (dkf->age[j] >= 0)
            dkf->age[j] += 1; /* until it is heard */
    return take_channels(dkf, measurement);
}

int dse_dkf_message(const struct dse_dkf *dkf, int listener, dse_real *message)
{
    const int n = dkf->nx;
    if (listener < 0 || listener >= dkf->config->n_listeners)
        return 0;
    if (!dkf->full) {
        const struct dse_dkf_sensor *sensor = &dkf->config->listeners[listener];
        dkf_apply(sensor->ny, n, sensor->C, dkf->now, message); /* C_j xh_i */
        return sensor->ny;
    }
    for (int i = 0; i < n; i++)
        message[i] = dkf->now[i];
    return n;
}

int dse_dkf_message_size(const struct dse_dkf *dkf)
{
    return dkf->full ? dkf->nx : dkf->ny;
}

static void come_back(struct dse_dkf *dkf, int neighbour)
{
    const int square = dkf->ny * dkf->ny;
    dse_real *gain = dkf_parts(dkf, dkf->now).gains + neighbour * square;
    dkf->counts.rejoined += dkf->age[neighbour] == DKF_GONE;
    for (int k = 0; dkf->config->scheme == DSE_DKF_EDGE && k < square; k++)
        gain[k] = 0;
}

enum dse_status dse_dkf_receive(struct dse_dkf *dkf, int neighbour, const dse_real *message,
                                int count)
{
    if (neighbour < 0 || neighbour >= dkf->config->n_neighbours)
        return DSE_EINVAL;
    const bool fits = count == dse_dkf_message_size(dkf);
    if (!fits || !dse_all_finite(message, count)) {
        dkf->counts.refused++;
        dkf->refused = true;
        return fits ? DSE_ENONFINITE : DSE_EDIM;
    }
    if (dkf->age[neighbour] < 0)
        come_back(dkf, neighbour);
    dkf->age[neighbour] = 0;
    dkf->counts.heard++;
    dse_real *said = dkf->said + neighbour * dkf->width;
    if (count != dkf->width) { /* a whole state, of which this node looks at its own outputs */
        dkf_apply(dkf->ny, dkf->nx, dkf->config->sensor.C, message, said);
        return DSE_OK;
    }
    for (int l = 0; l < count; l++)
        said[l] = message[l];
    return DSE_OK;
}

static void grow_older(struct dse_dkf *dkf)
{
    for (int j = 0; j < dkf->config->n_neighbours; j++) {
        if (dkf->age[j] <= 0)
            continue;
        if (dkf->age[j] > (dse_real)dkf->hold) {
            dkf->age[j] = DKF_GONE;
            dkf->counts.dropped++;
        } else {
            dkf->counts.held++;
        }
    }
}

static enum dse_status end_step(struct dse_dkf *dkf, enum dse_status status)
{
    if (status != DSE_OK) {
        dkf->counts.failed++;
        dkf->health = DSE_HEALTH_DIVERGED;
    }
    return status;
}

/* Neighbours that it works with, none of whom is in use. */
static bool alone(const struct dse_dkf *dkf)
{
    if (dkf->config->scheme == DSE_DKF_ALONE || dkf->config->n_neighbours == 0)
        return false;
    for (int j = 0; j < dkf->config->n_neighbours; j++)
        if (dkf->age[j] >= 0)
            return false;
    return true;
}

static enum dse_health health_now(const struct dse_dkf *dkf)
{
    if (dkf->counts.used == 0)
        return DSE_HEALTH_INITIALISING;
    if (dkf->present == 0)
        return DSE_HEALTH_COASTING;
    if (dkf->refused)
        return DSE_HEALTH_REJECTING;
    return alone(dkf) ? DSE_HEALTH_ALONE : DSE_HEALTH_TRACKING;
}

enum dse_status dse_dkf_correct(struct dse_dkf *dkf)
{
    if (dkf->corrected)
        return DSE_OK;
    grow_older(dkf);
    enum dse_status status = DSE_OK;
    if (dkf->discrete && dkf->riccati)
        status = dkf_correct_discrete(dkf);
    else /* scratch holds C x */
        dkf_residual(dkf, dkf->now, dkf->scratch, dkf->residual);
    if (status == DSE_OK) {
        dkf->corrected = true;
        if (dkf->health != DSE_HEALTH_DIVERGED)
            dkf->health = health_now(dkf);
    }
    return end_step(dkf, status);
}

enum dse_status dse_dkf_advance(struct dse_dkf *dkf)
{
    if (!dkf->corrected)
        return DSE_EINVAL;
    enum dse_status status = DSE_OK;
    if (!dkf->discrete)
        status = dkf_advance_continuous(dkf);
    else if (!dkf->riccati)
        status = dkf_advance_predictor(dkf);
    if (status == DSE_OK) {
        dse_real *now = dkf->next;
        dkf->next = dkf->now;
        dkf->now = now;
        dkf->counts.steps++;
        dkf->health = health_now(dkf);
    }
    dkf->corrected = false;
    return end_step(dkf, status);
}

/* ---- the network's gain ---- */

void dse_dkf_global_term(struct dse_dkf *dkf, dse_real *term)
{
    const int m = dkf->ny;
    dse_real *scratch = dkf->scratch;
    dse_real *Cx = dkf_take(&scratch, m), *eps = dkf_take(&scratch, m), *s = scratch;
    dkf_residual(dkf, dkf->now, Cx, eps);
    for (int l = 0; l < m; l++) {
        s[l] = 0;
        for (int j = 0; j < dkf->config->n_neighbours; j++)
            if (dkf->age[j] == 0)
                s[l] += dkf->said[j * m + l] - Cx[l];
    }
    for (int r = 0; r < m; r++)
        for (int c = 0; c < m; c++)
            term[r * m + c] = eps[r] * s[c];
}

enum dse_status dse_dkf_global_sum(struct dse_dkf *dkf, const dse_real *sum)
{
    const int square = dkf->ny * dkf->ny;
    if (dkf->config->scheme != DSE_DKF_GLOBAL)
        return DSE_EINVAL;
    if (!dse_all_finite(sum, square)) {
        dkf->counts.refused++;
        dkf->refused = true;
        return DSE_ENONFINITE;
    }
    for (int k = 0; k < square; k++)
        dkf->global[k] = sum[k];
    dkf->has_global = true;
    return DSE_OK;
}

/* ---- reading ---- */

const dse_real *dse_dkf_state(const struct dse_dkf *dkf)
{
    return dkf->corrected && dkf->filtered != NULL ? dkf->filtered : dkf->now;
}

const dse_real *dse_dkf_covariance(const struct dse_dkf *dkf)
{
    return dkf_parts(dkf, dkf->now).P;
}

const dse_real *dse_dkf_lyapunov(const struct dse_dkf *dkf)
{
    return dkf_parts(dkf, dkf->now).W;
}

const dse_real *dse_dkf_direction(const struct dse_dkf *dkf)
{
    return dkf->direction;
}

const dse_real *dse_dkf_gain(const struct dse_dkf *dkf, int j)
{
    if (j < 0 || j >= dkf->n_gains)
        return NULL;
    /* a discrete correction has moved them before they acted */
    dse_real *state = dkf->corrected && dkf->filtered != NULL ? dkf->next : dkf->now;
    return dkf_parts(dkf, state).gains + j * dkf->ny * dkf->ny;
}

const dse_real *dse_dkf_residual(const struct dse_dkf *dkf)
{
    return dkf->residual;
}

bool dse_dkf_uses(const struct dse_dkf *dkf, int j)
{
    return j >= 0 && j < dkf->config->n_neighbours && dkf->age[j] >= 0;
}

dse_real dse_dkf_largest_gain(const struct dse_dkf *dkf)
{
    dse_real largest = 0;
    for (int j = 0; j < dkf->n_gains; j++)
        largest = dse_max(largest, dse_norm2(dkf->ny * dkf->ny, dse_dkf_gain(dkf, j)));
    return largest;
}

enum dse_health dse_dkf_health(const struct dse_dkf *dkf)
{
    return dkf->health;
}

const struct dse_dkf_counts *dse_dkf_counts(const struct dse_dkf *dkf)
{
    return &dkf->counts;
}
