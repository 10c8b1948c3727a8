/* Jacobians of a model against central differences. */
#include "dse/model.h"

#include <stddef.h>

#include "dse/math.h"

/* f, h and dfdx, dhdx have one type. */
typedef enum dse_status (*model_function)(const struct dse_model *model, dse_real t,
                                          const dse_real *x, const dse_real *u, dse_real *result);

/* Where a Jacobian is compared. */
struct point {
    dse_real t;
    const dse_real *x;
    const dse_real *u;
};

static dse_real size_of_state(dse_real x)
{
    return x == 0 ? 1 : dse_abs(x);
}

/* eps^(1/3): balances the truncation error of a central difference, step^2, with its rounding
 * error, eps / step. */
static dse_real relative_step(void)
{
    return dse_exp(dse_log(DSE_REAL_EPSILON) / 3);
}

/* Column j of D (m x nx): (g(x + s e_j) - g(x - s e_j)) / 2s. scratch: nx + 2 m. */
static enum dse_status difference_column(const struct dse_model *model, model_function g, int m,
                                         const struct point *at, int j, dse_real *D,
                                         dse_real *scratch)
{
    const int nx = model->nx;
    dse_real *x = scratch, *above = x + nx, *below = above + m;
    for (int i = 0; i < nx; i++)
        x[i] = at->x[i];

    dse_real step = relative_step() * size_of_state(at->x[j]);
    x[j] = at->x[j] + step;
    dse_real span = x[j];
    enum dse_status status = g(model, at->t, x, at->u, above);
    if (status != DSE_OK)
        return status;
    x[j] = at->x[j] - step;
    span -= x[j]; /* as it really is after rounding */
    status = g(model, at->t, x, at->u, below);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < m; i++)
        D[i * nx + j] = (above[i] - below[i]) / span;
    return DSE_OK;
}

/* The largest relative deviation in one row of J and D (nx each), as defined in the header. */
static dse_real row_deviation(int nx, const dse_real *x, const dse_real *J, const dse_real *D)
{
    dse_real effect = 0;
    for (int j = 0; j < nx; j++)
        effect = dse_max(effect, dse_abs(D[j]) * size_of_state(x[j]));
    dse_real worst = 0;
    for (int j = 0; j < nx; j++) {
        dse_real lowest = relative_step() * effect / size_of_state(x[j]);
        dse_real deviation = dse_abs(J[j] - D[j]);
        dse_real size = dse_max(dse_abs(J[j]), dse_abs(D[j])) + lowest;
        if (deviation != 0) /* else 0/0 in a row of zeros */
            worst = dse_max(worst, deviation / size);
    }
    return worst;
}

/* The largest relative deviation of `jacobian` from differences of g (m values). */
static enum dse_status compare(const struct dse_model *model, model_function g,
                               model_function jacobian, int m, const struct point *at,
                               dse_real *scratch, dse_real *worst)
{
    const int nx = model->nx;
    dse_real *J = scratch, *D = J + m * nx, *rest = D + m * nx;
    if (jacobian == NULL)
        return DSE_EINVAL;
    enum dse_status status = jacobian(model, at->t, at->x, at->u, J);
    for (int j = 0; j < nx && status == DSE_OK; j++)
        status = difference_column(model, g, m, at, j, D, rest);
    if (status != DSE_OK)
        return status;
    *worst = 0;
    for (int i = 0; i < m; i++)
        *worst = dse_max(*worst, row_deviation(nx, at->x, J + i * nx, D + i * nx));
    return dse_is_finite(*worst) ? DSE_OK : DSE_ENONFINITE;
}

enum dse_status dse_model_check_jacobians(const struct dse_model *model, dse_real t,
                                          const dse_real *x, const dse_real *u, dse_real *scratch,
                                          dse_real *worst_f, dse_real *worst_h)
{
    const struct point at = {t, x, u};
    enum dse_status status = DSE_OK;
    if (worst_f != NULL)
        status = compare(model, model->f, model->dfdx, model->nx, &at, scratch, worst_f);
    if (status == DSE_OK && worst_h != NULL)
        status = compare(model, model->h, model->dhdx, model->ny, &at, scratch, worst_h);
    return status;
}
