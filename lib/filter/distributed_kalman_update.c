/* Distributed Kalman filter: the covariance after a sampled measurement. */
#include "distributed_kalman_internal.h"

struct dkf_update dkf_update_in(const struct dse_dkf *dkf, dse_real **scratch)
{
    const int n = dkf->nx, m = dkf->ny;
    struct dkf_update update;
    update.J = dkf_take(scratch, n * n);
    update.M = dkf_take(scratch, n * n);
    update.LU = dkf_take(scratch, n * n);
    update.K = dkf_take(scratch, n * m);
    update.Kt = dkf_take(scratch, m * n);
    update.CP = dkf_take(scratch, m * n);
    update.Z = dkf_take(scratch, n * m);
    update.S = dkf_take(scratch, m * m);
    update.noise = dkf_take(scratch, m * m);
    update.Cx = dkf_take(scratch, m);
    update.eps = dkf_take(scratch, m);
    return update;
}

/* The rows of missing channels in the innovation's covariance are those of the identity and their
 * right-hand sides zero: so are their columns of K. */
static enum dse_status kalman_gain(const struct dse_dkf *dkf, dse_real w, const dse_real *P,
                                   struct dkf_update *update)
{
    const int n = dkf->nx, m = dkf->ny;
    const dse_real *C = dkf->config->sensor.C, *R = dkf->config->R;
    dse_mat_mul(m, n, n, C, P, update->CP);
    dse_mat_mul_nt(m, n, m, update->CP, C, update->S);
    for (int r = 0; r < m; r++) {
        for (int c = 0; c < m; c++) {
            const bool both = dkf->has[r] != 0 && dkf->has[c] != 0;
            dse_real *noise = &update->noise[r * m + c], *S = &update->S[r * m + c];
            *noise = both ? w * R[r * m + c] : 0;
            *S = both ? *S + *noise : (dse_real)(r == c);
        }
        for (int i = 0; i < n; i++)
            update->Kt[r * n + i] = dkf->has[r] != 0 ? update->CP[r * n + i] : 0;
    }
    const enum dse_status status = dse_cholesky(m, update->S, update->S);
    if (status != DSE_OK)
        return status;
    dse_cholesky_solve(m, update->S, n, update->Kt);
    dse_mat_transpose(m, n, update->Kt, update->K);
    return DSE_OK;
}

enum dse_status dkf_update_covariance(const struct dse_dkf *dkf, dse_real w, const dse_real *P,
                                      struct dkf_update *update)
{
    const int n = dkf->nx, m = dkf->ny;
    const enum dse_status status = kalman_gain(dkf, w, P, update);
    if (status != DSE_OK)
        return status;
    dse_mat_mul(n, m, n, update->K, dkf->config->sensor.C, update->J);
    for (int k = 0; k < n * n; k++)
        update->J[k] = (dse_real)(k % (n + 1) == 0) - update->J[k];
    dse_sym_congruence(n, m, update->K, update->noise, NULL, update->M, update->Z);
    dse_sym_congruence(n, n, update->J, P, update->M, update->M, update->LU);
    return DSE_OK;
}
