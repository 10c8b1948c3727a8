/* The plant's right-hand side with held process noise and its inputs, and what went wrong in it. */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "dse/math.h"
#include "sim/integrator_internal.h"

bool sim_reason(char *text, int size, const char *format, ...)
{
    if (size <= 0)
        return false;
    size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text + used, (size_t)size - used, format, arguments);
    va_end(arguments);
    return false;
}

static enum dse_status fail(struct sim_field *field, enum dse_status status, double t, int state)
{
    field->fault = status;
    field->fault_time = t;
    field->fault_state = state;
    return status;
}

const double *sim_field_inputs(struct sim_field *field, double t)
{
    if (field->driver == NULL || !sim_driver_moves(field->driver))
        return field->u;
    memcpy(field->moved, field->u, (size_t)field->model.nu * sizeof *field->moved);
    sim_driver_move(field->driver, t, field->moved);
    return field->moved;
}

enum dse_status sim_field_rhs(void *context, double t, const double *x, double *dx)
{
    struct sim_field *field = context;
    const struct dse_model *model = &field->model;
    enum dse_status status = model->f(model, t, x, sim_field_inputs(field, t), dx);
    if (status != DSE_OK)
        return fail(field, status, t, -1);
    for (int j = 0; j < model->nx; j++) {
        dx[j] += field->w[j];
        if (!dse_is_finite(dx[j]))
            return fail(field, DSE_ENONFINITE, t, j);
    }
    return DSE_OK;
}

void sim_field_explain(const struct sim_field *field, char *text, int size)
{
    if (field->fault == DSE_OK)
        return;
    if (field->fault_state >= 0)
        sim_reason(text, size, "; the %s of %s is not finite",
                   field->model.time == DSE_DISCRETE ? "next value" : "derivative",
                   field->plant->states[field->fault_state].name);
    else
        sim_reason(text, size, "; %s", dse_status_text(field->fault));
    sim_reason(text, size, " at t = %.9g %s", field->fault_time, field->plant->time_unit);
}
