#include <math.h>
#include <string.h>

#include "high_gain_plant.h"

#include "dse/linalg.h"

const int linear_outputs[LINEAR_P] = {0, 2, 3};

/* clang-format off */
const struct linear coupled = {.A = {0,             1,  0,  0,  0,
                                     -8,            -4, 1,  0,  0,
                                     DSE_REAL(0.5), 0,  -3, 1,  0,
                                     0,             0,  0,  0,  1,
                                     1,             0,  2,  -9, -5}};
/* clang-format on */

static enum dse_status linear_field(const struct linear *linear, int n, const dse_real *x,
                                    dse_real *dx)
{
    if (linear->broken) {
        return DSE_EMODEL;
    }
    dse_mat_vec(n, n, linear->A, x, dx);
    if (linear->wild) {
        dx[0] = (dse_real)INFINITY;
    }
    return DSE_OK;
}

static enum dse_status linear_f(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *dx)
{
    (void)t;
    (void)u;
    return linear_field(model->parameters, model->nx, x, dx);
}

static enum dse_status linear_h(const struct dse_model *model, dse_real t, const dse_real *x,
                                const dse_real *u, dse_real *y)
{
    (void)t;
    (void)u;
    for (int j = 0; j < model->ny && j < LINEAR_P; j++) {
        y[j] = x[linear_outputs[j]];
    }
    return DSE_OK;
}

static enum dse_status linear_dfdx(const struct dse_model *model, dse_real t, const dse_real *x,
                                   const dse_real *u, dse_real *F)
{
    const struct linear *linear = model->parameters;
    (void)t;
    (void)x;
    (void)u;
    memcpy(F, linear->A, (size_t)(model->nx * model->nx) * sizeof *F);
    return DSE_OK;
}

static enum dse_status same(const struct dse_normal_form *form, dse_real t, const dse_real *in,
                            const dse_real *u, dse_real *out)
{
    (void)t;
    (void)u;
    memcpy(out, in, (size_t)form->n * sizeof *out);
    return DSE_OK;
}

static enum dse_status form_field(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                                  const dse_real *u, dse_real *dz)
{
    (void)t;
    (void)u;
    return linear_field(form->parameters, form->n, z, dz);
}

static enum dse_status form_jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                     const dse_real *z, const dse_real *u, dse_real *F)
{
    const struct linear *linear = form->parameters;
    const int n_i = form->n_i[i];
    int offset = 0;
    (void)t;
    (void)z;
    (void)u;
    for (int j = 0; j < i; j++) {
        offset += form->n_i[j];
    }
    for (int r = 0; r < n_i; r++) {
        for (int c = 0; c < n_i; c++) {
            F[r * n_i + c] = linear->A[(offset + r) * form->n + offset + c];
        }
    }
    return DSE_OK;
}

static enum dse_status form_map(const struct dse_normal_form *form, int i, dse_real t,
                                const dse_real *chi, const dse_real *u, dse_real *M)
{
    (void)t;
    (void)chi;
    (void)u;
    dse_mat_identity(form->n_i[i], M);
    return DSE_OK;
}

static enum dse_status form_push(const struct dse_normal_form *form, dse_real t,
                                 const dse_real *chi, const dse_real *u, const dse_real *dchi,
                                 dse_real *dz)
{
    (void)chi;
    return same(form, t, dchi, u, dz);
}

static enum dse_status form_whole_jacobian(const struct dse_normal_form *form, dse_real t,
                                           const dse_real *z, const dse_real *u, dse_real *F)
{
    const struct linear *linear = form->parameters;
    (void)t;
    (void)z;
    (void)u;
    memcpy(F, linear->A, (size_t)(form->n * form->n) * sizeof *F);
    return DSE_OK;
}

void linear_plant(const struct linear *linear, int p, struct dse_model *model,
                  struct dse_normal_form *form)
{
    static const int three[3] = {2, 1, 2}, two[2] = {3, 2}, one[1] = {5};
    static const int outputs_of_two[2] = {2, 1}, outputs_of_one[1] = {3};
    *model = (struct dse_model){.time = DSE_CONTINUOUS,
                                .nx = LINEAR_N,
                                .ny = LINEAR_P,
                                .parameters = linear,
                                .f = linear_f,
                                .h = linear_h,
                                .dfdx = linear_dfdx};
    *form = (struct dse_normal_form){.n = LINEAR_N,
                                     .p = p,
                                     .n_i = p == 3   ? three
                                            : p == 2 ? two
                                                     : one,
                                     .n_outputs = p == 3   ? NULL
                                                  : p == 2 ? outputs_of_two
                                                           : outputs_of_one,
                                     .chains = p == 3 ? NULL : three,
                                     .parameters = linear,
                                     .encode = same,
                                     .decode = same,
                                     .field = form_field,
                                     .jacobian = form_jacobian,
                                     .map_jacobian = form_map,
                                     .push = form_push,
                                     .field_jacobian = form_whole_jacobian};
}

void linear_block(const struct linear *linear, struct dse_model *model,
                  struct dse_normal_form *form)
{
    linear_plant(linear, 3, model, form);
    model->nx = form->n = 2;
    model->ny = form->p = 1;
}
