/* Some subsystems of a plant as a plant of their own. */
#include "dse/part.h"

#include <stddef.h>

/* ---- between part and whole ---- */

static const dse_real *put(const struct dse_part *part, const dse_real *from, dse_real *whole)
{
    for (int k = 0; k < part->model.nx; k++) {
        whole[part->state[k]] = from[k];
    }
    return whole;
}

static void get(const struct dse_part *part, const dse_real *whole, dse_real *to)
{
    for (int k = 0; k < part->model.nx; k++) {
        to[k] = whole[part->state[k]];
    }
}

/* ---- the model ---- */

static enum dse_status derivative(const struct dse_model *model, dse_real t, const dse_real *x,
                                  const dse_real *u, dse_real *dx)
{
    const struct dse_part *part = model->parameters;
    const enum dse_status status =
        part->whole->f(part->whole, t, put(part, x, part->x), u, part->dx);
    get(part, part->dx, dx);
    return status;
}

static enum dse_status derivatives(const struct dse_model *model, dse_real t, int count,
                                   const dse_real *x, const dse_real *u, dse_real *dx)
{
    const struct dse_part *part = model->parameters;
    const int n = part->whole->nx;
    enum dse_status status = DSE_OK;
    for (int first = 0; first < count && status == DSE_OK; first += DSE_PART_LANES) {
        const int lanes = count - first < DSE_PART_LANES ? count - first : DSE_PART_LANES;
        for (int l = 0; l < lanes; l++) {
            put(part, x + (first + l) * model->nx, part->many + l * n);
        }
        status = part->whole->f_many(part->whole, t, lanes, part->many, u, part->dmany);
        for (int l = 0; l < lanes; l++) {
            get(part, part->dmany + l * n, dx + (first + l) * model->nx);
        }
    }
    return status;
}

static enum dse_status output(const struct dse_model *model, dse_real t, const dse_real *x,
                              const dse_real *u, dse_real *y)
{
    const struct dse_part *part = model->parameters;
    const enum dse_status status =
        part->whole->h(part->whole, t, put(part, x, part->x), u, part->y);
    for (int l = 0; l < model->ny; l++) {
        y[l] = part->y[part->output[l]];
    }
    return status;
}

static enum dse_status derivative_jacobian(const struct dse_model *model, dse_real t,
                                           const dse_real *x, const dse_real *u, dse_real *F)
{
    const struct dse_part *part = model->parameters;
    const int n = model->nx;
    const enum dse_status status =
        part->whole->dfdx(part->whole, t, put(part, x, part->x), u, part->F);
    for (int r = 0; r < n; r++) {
        get(part, part->F + part->state[r] * part->whole->nx, F + r * n);
    }
    return status;
}

static enum dse_status output_jacobian(const struct dse_model *model, dse_real t, const dse_real *x,
                                       const dse_real *u, dse_real *H)
{
    const struct dse_part *part = model->parameters;
    const enum dse_status status =
        part->whole->dhdx(part->whole, t, put(part, x, part->x), u, part->F);
    for (int l = 0; l < model->ny; l++) {
        get(part, part->F + part->output[l] * part->whole->nx, H + l * model->nx);
    }
    return status;
}

/* ---- the coordinates ---- */

static enum dse_status encode(const struct dse_normal_form *form, dse_real t, const dse_real *chi,
                              const dse_real *u, dse_real *z)
{
    const struct dse_part *part = form->parameters;
    const enum dse_status status =
        part->whole_form->encode(part->whole_form, t, put(part, chi, part->x), u, part->dx);
    get(part, part->dx, z);
    return status;
}

static enum dse_status decode(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                              const dse_real *u, dse_real *chi)
{
    const struct dse_part *part = form->parameters;
    const enum dse_status status =
        part->whole_form->decode(part->whole_form, t, put(part, z, part->z), u, part->dx);
    get(part, part->dx, chi);
    return status;
}

static enum dse_status field(const struct dse_normal_form *form, dse_real t, const dse_real *z,
                             const dse_real *u, dse_real *dz)
{
    const struct dse_part *part = form->parameters;
    const enum dse_status status =
        part->whole_form->field(part->whole_form, t, put(part, z, part->z), u, part->dx);
    get(part, part->dx, dz);
    return status;
}

static enum dse_status jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                const dse_real *z, const dse_real *u, dse_real *F)
{
    const struct dse_part *part = form->parameters;
    return part->whole_form->jacobian(part->whole_form, part->block[i], t, put(part, z, part->z), u,
                                      F);
}

static enum dse_status map_jacobian(const struct dse_normal_form *form, int i, dse_real t,
                                    const dse_real *chi, const dse_real *u, dse_real *M)
{
    const struct dse_part *part = form->parameters;
    return part->whole_form->map_jacobian(part->whole_form, part->block[i], t,
                                          put(part, chi, part->x), u, M);
}

/* What lies outside stands still: its change is 0. */
static enum dse_status push(const struct dse_normal_form *form, dse_real t, const dse_real *chi,
                            const dse_real *u, const dse_real *dchi, dse_real *dz)
{
    const struct dse_part *part = form->parameters;
    dse_real *change = part->many;
    for (int k = 0; k < part->whole->nx; k++) {
        change[k] = 0;
    }
    put(part, dchi, change);
    const enum dse_status status =
        part->whole_form->push(part->whole_form, t, put(part, chi, part->x), u, change, part->dx);
    for (int k = 0; k < part->whole->nx; k++) {
        change[k] = part->x[k]; /* a lane again, with the outside in it */
    }
    get(part, part->dx, dz);
    return status;
}

/* ---- making it ---- */

static bool blocks_are_right(const struct dse_normal_form *form, const int *block, int blocks)
{
    for (int b = 0; b < blocks; b++) {
        if (block[b] < 0 || block[b] >= form->p || (b > 0 && block[b] <= block[b - 1])) {
            return false;
        }
    }
    return blocks >= 1;
}

static int outputs_of(const struct dse_normal_form *form, int j)
{
    return form->n_outputs != NULL ? form->n_outputs[j] : 1;
}

/* Fills the lists of what is chosen, and counts its states and outputs. */
static void choose(struct dse_part *part)
{
    const struct dse_normal_form *form = part->whole_form;
    int state = 0, output_before = 0, b = 0;
    for (int j = 0; j < form->p; j++) {
        const int m = outputs_of(form, j);
        if (b < part->blocks && part->block[b] == j) {
            for (int k = 0; k < form->n_i[j]; k++) {
                part->state[part->model.nx++] = state + k;
            }
            for (int l = 0; l < m; l++) {
                part->chains[part->model.ny] =
                    form->chains != NULL ? form->chains[output_before + l] : form->n_i[j];
                part->output[part->model.ny++] = output_before + l;
            }
            part->n_i[b] = form->n_i[j];
            part->n_outputs[b++] = m;
        }
        state += form->n_i[j];
        output_before += m;
    }
}

static bool take_memory(struct dse_part *part, struct dse_arena *arena)
{
    const int n = part->whole->nx, ny = part->whole->ny;
    part->state = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(n));
    part->output = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(ny));
    part->chains = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(ny));
    part->n_i = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(part->whole_form->p));
    part->n_outputs = (int *)(void *)dse_arena_take(arena, DSE_ARENA_INTS(part->whole_form->p));
    part->x = dse_arena_take(arena, n);
    part->z = dse_arena_take(arena, n);
    part->dx = dse_arena_take(arena, n);
    part->many = dse_arena_take(arena, DSE_PART_LANES * n);
    part->dmany = dse_arena_take(arena, DSE_PART_LANES * n);
    part->y = dse_arena_take(arena, ny);
    part->F = dse_arena_take(arena, n * (n > ny ? n : ny));
    return part->state != NULL && part->output != NULL && part->chains != NULL &&
           part->n_i != NULL && part->n_outputs != NULL && part->x != NULL && part->z != NULL &&
           part->dx != NULL && part->many != NULL && part->dmany != NULL && part->F != NULL &&
           (part->y != NULL || ny == 0);
}

static void fill_model(struct dse_part *part)
{
    const struct dse_model *whole = part->whole;
    part->model.time = whole->time;
    part->model.nu = whole->nu;
    part->model.parameters = part;
    part->model.f = derivative;
    part->model.h = output;
    part->model.dfdx = whole->dfdx != NULL ? derivative_jacobian : NULL;
    part->model.dhdx = whole->dhdx != NULL ? output_jacobian : NULL;
    part->model.f_many = whole->f_many != NULL ? derivatives : NULL;
}

static void fill_form(struct dse_part *part)
{
    const struct dse_normal_form *whole = part->whole_form;
    part->form = (struct dse_normal_form){
        .n = part->model.nx,
        .p = part->blocks,
        .n_i = part->n_i,
        .n_outputs = part->n_outputs,
        .chains = part->chains,
        .nu = whole->nu,
        .rates = whole->rates,
        .map_without_inputs = whole->map_without_inputs,
        .parameters = part,
        .encode = whole->encode != NULL ? encode : NULL,
        .decode = whole->decode != NULL ? decode : NULL,
        .field = whole->field != NULL ? field : NULL,
        .jacobian = whole->jacobian != NULL ? jacobian : NULL,
        .map_jacobian = whole->map_jacobian != NULL ? map_jacobian : NULL,
        .push = whole->push != NULL ? push : NULL,
    };
}

enum dse_status dse_part_init(struct dse_part *part, const struct dse_model *whole,
                              const struct dse_normal_form *form, const int *block, int blocks,
                              const dse_real *x, const dse_real *u, struct dse_arena *arena)
{
    if (part == NULL || whole == NULL || form == NULL || block == NULL || x == NULL ||
        arena == NULL || whole->f == NULL || whole->h == NULL || form->n_i == NULL ||
        !blocks_are_right(form, block, blocks)) {
        return DSE_EINVAL;
    }
    int states = 0, outputs = 0;
    for (int j = 0; j < form->p; j++) {
        states += form->n_i[j];
        outputs += outputs_of(form, j);
    }
    if (whole->nx != form->n || states != form->n || whole->ny < outputs) {
        return DSE_EDIM;
    }
    *part = (struct dse_part){.whole = whole, .whole_form = form, .block = block, .blocks = blocks};
    if (!take_memory(part, arena)) {
        return DSE_ESTORAGE;
    }
    choose(part);
    for (int k = 0; k < whole->nx; k++) {
        part->x[k] = x[k];
        for (int l = 0; l < DSE_PART_LANES; l++) {
            part->many[l * whole->nx + k] = x[k];
        }
    }
    fill_model(part);
    fill_form(part);
    return form->encode != NULL ? form->encode(form, 0, part->x, u, part->z) : DSE_OK;
}

/* ---- is it closed? ---- */

/* The subsystem of a state. */
static int block_of(const struct dse_normal_form *form, int state)
{
    int j = 0;
    while (state >= form->n_i[j]) {
        state -= form->n_i[j++];
    }
    return j;
}

static bool is_chosen(const struct dse_part *part, int j)
{
    int b = 0;
    while (b < part->blocks && part->block[b] != j) {
        b++;
    }
    return b < part->blocks;
}

enum dse_status dse_part_closed(const struct dse_part *part, dse_real t, const dse_real *u, int *by,
                                int *on)
{
    const int n = part->whole->nx;
    if (part->whole->dfdx == NULL) {
        return DSE_EINVAL;
    }
    const enum dse_status status = part->whole->dfdx(part->whole, t, part->x, u, part->F);
    if (status != DSE_OK) {
        return status;
    }
    for (int k = 0; k < part->model.nx; k++) {
        const dse_real *row = part->F + part->state[k] * n;
        for (int c = 0; c < n; c++) {
            if (!is_chosen(part, block_of(part->whole_form, c)) && (row[c] < 0 || row[c] > 0)) {
                *by = block_of(part->whole_form, c);
                *on = block_of(part->whole_form, part->state[k]);
                return DSE_EINVAL;
            }
        }
    }
    return DSE_OK;
}
