/* Pictures in the coordinates of the filter: decoding, encoding anew, their maps and fields. */
#include <stddef.h>

#include "dse/math.h"
#include "high_gain_ekf_internal.h"

int dse_high_gain_offset(const struct dse_normal_form *form, int j)
{
    int offset = 0;
    for (int l = 0; l < j; l++) {
        offset += form->n_i[l];
    }
    return offset;
}

const dse_real *dse_high_gain_inputs(const dse_real *u, const dse_real *du, bool moving, int nu,
                                     dse_real dt, dse_real *u_stage)
{
    if (!moving) {
        return u;
    }
    for (int k = 0; k < nu; k++) {
        u_stage[k] = u[k] + dt * du[k];
    }
    return u_stage;
}

bool dse_high_gain_rates(const struct dse_normal_form *form, const dse_real *u, dse_real *du)
{
    bool moving = false;
    for (int k = 0; k < form->nu; k++) {
        const int rate = form->rates != NULL ? form->rates[k] : -1;
        du[k] = rate >= 0 ? u[rate] : 0;
        moving = moving || dse_abs(du[k]) > 0;
    }
    return moving;
}

enum dse_status dse_high_gain_decode(const struct dse_high_gain_ekf *filter, dse_real t,
                                     const dse_real *x, const dse_real *u, dse_real *chi)
{
    const struct dse_normal_form *form = filter->config->form;
    if (filter->config->coords == DSE_HIGH_GAIN_NORMAL) {
        return form->decode(form, t, x, u, chi);
    }
    for (int k = 0; k < filter->n; k++) {
        chi[k] = x[k];
    }
    return DSE_OK;
}

static bool same_inputs(const struct dse_high_gain_ekf *filter, const dse_real *a,
                        const dse_real *b)
{
    for (int k = 0; k < filter->config->form->nu; k++) {
        if (dse_abs(a[k] - b[k]) > 0) {
            return false;
        }
    }
    return true;
}

enum dse_status dse_high_gain_recode(struct dse_high_gain_ekf *filter, dse_real t,
                                     const dse_real *from, const dse_real *to, dse_real *x)
{
    const struct dse_normal_form *form = filter->config->form;
    if (filter->config->coords != DSE_HIGH_GAIN_NORMAL || form->map_without_inputs ||
        same_inputs(filter, from, to)) {
        return DSE_OK;
    }
    const enum dse_status status = form->decode(form, t, x, from, filter->chi);
    return status != DSE_OK ? status : form->encode(form, t, filter->chi, to, x);
}

enum dse_status dse_high_gain_map(struct dse_high_gain_ekf *filter, dse_real t, const dse_real *chi,
                                  const dse_real *u)
{
    const struct dse_normal_form *form = filter->config->form;
    const int n = filter->n;
    dse_real *unit = filter->w, *column = filter->w + n;
    enum dse_status status = DSE_OK;

    if (!filter->config->whole) {
        return form->map_jacobian(form, filter->config->i, t, chi, u, filter->M);
    }
    for (int c = 0; c < n; c++) {
        unit[c] = 0;
    }
    for (int c = 0; c < n && status == DSE_OK; c++) {
        unit[c] = 1;
        status = form->push(form, t, chi, u, unit, column);
        unit[c] = 0;
        for (int r = 0; r < n; r++) {
            filter->M[r * n + c] = column[r];
        }
    }
    return status;
}

enum dse_status dse_high_gain_field(const struct dse_high_gain_ekf *filter, dse_real t,
                                    const dse_real *x, const dse_real *u, dse_real *dx)
{
    const struct dse_normal_form *form = filter->config->form;
    const struct dse_model *model = filter->config->model;
    return filter->config->coords == DSE_HIGH_GAIN_NORMAL ? form->field(form, t, x, u, dx)
                                                          : model->f(model, t, x, u, dx);
}

/* In normal coordinates the wrong model moves the state along with the nominal map:
 *     z' = A z + b(z, u) + (dPhi/dchi) (f_wrong - f) */
enum dse_status dse_high_gain_predictor_field(struct dse_high_gain_ekf *filter, dse_real t,
                                              const dse_real *x, const dse_real *u, dse_real *dx)
{
    const struct dse_high_gain_ekf_config *config = filter->config;
    const struct dse_normal_form *form = config->form;
    const struct dse_model *wrong = config->predictor_model;
    dse_real *difference = filter->w, *pushed = filter->w + filter->n;

    if (wrong == NULL) {
        return dse_high_gain_field(filter, t, x, u, dx);
    }
    if (config->coords != DSE_HIGH_GAIN_NORMAL) {
        return wrong->f(wrong, t, x, u, dx);
    }
    enum dse_status status = form->field(form, t, x, u, dx);
    status = status != DSE_OK ? status : form->decode(form, t, x, u, filter->chi);
    status = status != DSE_OK ? status : wrong->f(wrong, t, filter->chi, u, difference);
    status = status != DSE_OK ? status : config->model->f(config->model, t, filter->chi, u, pushed);
    if (status != DSE_OK) {
        return status;
    }
    for (int k = 0; k < filter->n; k++) {
        difference[k] -= pushed[k];
    }
    status = form->push(form, t, filter->chi, u, difference, pushed);
    for (int k = 0; k < filter->n && status == DSE_OK; k++) {
        dx[k] += pushed[k];
    }
    return status;
}
