/* The quadratic system as a model. */
#include "dse/quadratic.h"

#include <stddef.h>

#include "dse/linalg.h"
#include "dse/math.h"

int dse_quadratic_terms(int n, const dse_real *F, int capacity, struct dse_quadratic_term *term)
{
    int count = 0;
    for (int k = 0; k < n; k++) {
        for (int i = 0; i < n; i++) {
            for (int j = i; j < n; j++) {
                const dse_real *F_k = F + k * n * n;
                const dse_real value = i == j ? F_k[i * n + i] : F_k[i * n + j] + F_k[j * n + i];
                if (value == 0)
                    continue;
                if (count < capacity)
                    term[count] = (struct dse_quadratic_term){k, i, j, value};
                count++;
            }
        }
    }
    return count;
}

enum dse_status dse_quadratic_check(int nx, int nu, int ny, const struct dse_quadratic *system)
{
    if (nx < 1 || nu < 0 || ny < 0 || system->A == NULL || (nu > 0 && system->B == NULL) ||
        (ny > 0 && system->C == NULL) || system->terms < 0 ||
        (system->terms > 0 && system->term == NULL))
        return DSE_EINVAL;
    for (int s = 0; s < system->terms; s++) {
        const struct dse_quadratic_term *term = &system->term[s];
        if (term->k < 0 || term->k >= nx || term->i < 0 || term->i > term->j || term->j >= nx)
            return DSE_EINVAL;
        if (!dse_is_finite(term->value))
            return DSE_ENONFINITE;
    }
    const bool finite = dse_all_finite(system->A, nx * nx) &&
                        (system->d == NULL || dse_all_finite(system->d, nx)) &&
                        (nu == 0 || dse_all_finite(system->B, nx * nu)) &&
                        (ny == 0 || dse_all_finite(system->C, ny * nx));
    return finite ? DSE_OK : DSE_ENONFINITE;
}

/* q_k = sum value x_i x_j. */
void dse_quadratic_add(const struct dse_quadratic *system, const dse_real *x, dse_real *dx)
{
    for (int s = 0; s < system->terms; s++) {
        const struct dse_quadratic_term *term = &system->term[s];
        dx[term->k] += term->value * x[term->i] * x[term->j];
    }
}

/* d(value x_i x_j) = value (x_j dx_i + x_i dx_j), also where i = j. */
void dse_quadratic_add_jacobian(int nx, const struct dse_quadratic *system, const dse_real *x,
                                dse_real *J)
{
    for (int s = 0; s < system->terms; s++) {
        const struct dse_quadratic_term *term = &system->term[s];
        dse_real *row = J + term->k * nx;
        row[term->i] += term->value * x[term->j];
        row[term->j] += term->value * x[term->i];
    }
}

/* E[x_i x_j] - E[x_i] E[x_j] = S_ij. */
void dse_quadratic_add_trace(int nx, const struct dse_quadratic *system, const dse_real *S,
                             dse_real *dx)
{
    for (int s = 0; s < system->terms; s++) {
        const struct dse_quadratic_term *term = &system->term[s];
        dx[term->k] += term->value * S[term->i * nx + term->j];
    }
}

/* F_k[i][j] = F_k[j][i] = value / 2, or value where i = j. */
dse_real dse_quadratic_norm(const struct dse_quadratic *system)
{
    dse_real largest = 0, sum = 0;
    for (int s = 0; s < system->terms; s++)
        largest = dse_max(largest, dse_abs(system->term[s].value));
    if (largest == 0)
        return 0;
    for (int s = 0; s < system->terms; s++) {
        const dse_real value = system->term[s].value / largest;
        sum += system->term[s].i == system->term[s].j ? value * value : value * value / 2;
    }
    return largest * dse_sqrt(sum);
}

/* ---- as a model ---- */

static enum dse_status quadratic_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *dx)
{
    (void)t;
    const struct dse_quadratic *system = model->parameters;
    const int nx = model->nx;
    dse_mat_vec(nx, nx, system->A, x, dx);
    for (int k = 0; k < nx; k++) {
        if (system->d != NULL)
            dx[k] += system->d[k];
        if (model->nu > 0)
            dx[k] += dse_dot(model->nu, system->B + k * model->nu, u);
    }
    dse_quadratic_add(system, x, dx);
    return DSE_OK;
}

static enum dse_status quadratic_h(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *y)
{
    (void)t, (void)u;
    const struct dse_quadratic *system = model->parameters;
    dse_mat_vec(model->ny, model->nx, system->C, x, y);
    return DSE_OK;
}

static enum dse_status quadratic_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                      const dse_real *u, dse_real *F)
{
    (void)t, (void)u;
    const struct dse_quadratic *system = model->parameters;
    for (int i = 0; i < model->nx * model->nx; i++)
        F[i] = system->A[i];
    dse_quadratic_add_jacobian(model->nx, system, x, F);
    return DSE_OK;
}

static enum dse_status quadratic_dhdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                      const dse_real *u, dse_real *H)
{
    (void)t, (void)x, (void)u;
    const struct dse_quadratic *system = model->parameters;
    for (int i = 0; i < model->ny * model->nx; i++)
        H[i] = system->C[i];
    return DSE_OK;
}

void dse_quadratic_model(struct dse_model *model, int nx, int nu, int ny,
                         const struct dse_quadratic *system)
{
    *model = (struct dse_model){
        .time = DSE_CONTINUOUS,
        .nx = nx,
        .nu = nu,
        .ny = ny,
        .parameters = system,
        .f = quadratic_f,
        .h = quadratic_h,
        .dfdx = quadratic_dfdx,
        .dhdx = quadratic_dhdx,
    };
}

const struct dse_quadratic *dse_quadratic_of(const struct dse_model *model)
{
    return model->f == quadratic_f ? model->parameters : NULL;
}
