/* Discretisation by the matrix exponential of the middle of a step. */
#include "methods/discretised.h"

static enum dse_status dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                            const dse_real *u, dse_real *F)
{
    const struct discretised *made = model->parameters;
    const int n = model->nx;
    dse_real *A = made->scratch;
    enum dse_status status = made->plant->dfdx(made->plant, t + made->period / 2, x, u, A);
    if (status != DSE_OK)
        return status;
    for (int k = 0; k < n * n; k++)
        A[k] *= made->period;
    return dse_expm(n, A, F, A + n * n);
}

void discretised_model(struct dse_model *model, const struct discretised *made)
{
    *model = (struct dse_model){
        .time = DSE_DISCRETE, .nx = made->plant->nx, .parameters = made, .dfdx = dfdx};
}
