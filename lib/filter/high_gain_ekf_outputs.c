/* What the own outputs do to block i: gain, correction and the information that they bring to the
 * covariance. Each output is the first entry of a chain; those that are missing in a tick are left
 * out of R_th as if they had never been there. */
#include "dse/linalg.h"
#include "high_gain_ekf_internal.h"

enum dse_status dse_high_gain_weigh_outputs(struct dse_high_gain_ekf *filter)
{
    const int q = filter->q;
    for (int a = 0; a < q; a++) {
        for (int b = 0; b < q; b++) {
            filter->W[a * q + b] = filter->R_th[filter->chosen[a] * filter->m + filter->chosen[b]];
        }
    }
    const enum dse_status status = dse_ldl(q, filter->W, filter->L, filter->D);
    if (status != DSE_OK) {
        return status;
    }
    dse_mat_identity(q, filter->W);
    dse_ldl_solve(q, filter->L, filter->D, q, filter->W);
    dse_sym_enforce(q, filter->W);
    return DSE_OK;
}

void dse_high_gain_output_errors(struct dse_high_gain_ekf *filter, const dse_real *z)
{
    for (int a = 0; a < filter->q; a++) {
        const int l = filter->chosen[a];
        filter->e[a] = filter->y[l] - z[filter->starts[l]];
    }
}

void dse_high_gain_correction(struct dse_high_gain_ekf *filter)
{
    const int n_i = filter->n_i;
    /* R_th^-1 C P: its transpose is the gain */
    for (int a = 0; a < filter->q; a++) {
        const int first = filter->starts[filter->chosen[a]];
        for (int r = 0; r < n_i; r++) {
            filter->CP[a * n_i + r] = filter->Ps[r * n_i + first];
        }
    }
    dse_ldl_solve(filter->q, filter->L, filter->D, n_i, filter->CP);
    for (int r = 0; r < n_i; r++) {
        filter->K[r] = filter->CP[r] * filter->e[0];
        for (int a = 1; a < filter->q; a++) {
            filter->K[r] += filter->CP[a * n_i + r] * filter->e[a];
        }
    }
}

/* (A.28); without a measurement the last term is not there. The lower triangle is computed, the
 * upper one is its image, so that P stays symmetric to the last bit. */
void dse_high_gain_riccati(struct dse_high_gain_ekf *filter)
{
    const int n_i = filter->n_i, q = filter->q;
    const dse_real *P = filter->Ps;
    const dse_real *FP = filter->FP;

    dse_mat_mul(n_i, n_i, n_i, filter->F, P, filter->FP);
    for (int r = 0; r < n_i; r++) {
        for (int c = 0; c <= r; c++) {
            dse_real dP = FP[r * n_i + c] + FP[c * n_i + r] + filter->Q_th[r * n_i + c];
            for (int a = 0; a < q; a++) {
                const dse_real left = P[r * n_i + filter->starts[filter->chosen[a]]];
                for (int b = 0; b < q; b++) {
                    dP -= left * P[c * n_i + filter->starts[filter->chosen[b]]] *
                          filter->W[a * q + b];
                }
            }
            filter->kP[r * n_i + c] = dP;
            filter->kP[c * n_i + r] = dP;
        }
    }
}
