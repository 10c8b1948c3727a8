/* Second-order filter: integration from sample to sample, adaptive or in guarded steps. */
#include "dse/linalg.h"
#include "dse/math.h"
#include "second_order_internal.h"

#ifdef DSE_REAL_IS_float
#define DEFAULT_RTOL DSE_REAL(1e-5)
#define DEFAULT_ATOL DSE_REAL(1e-7)
#else
#define DEFAULT_RTOL DSE_REAL(1e-8)
#define DEFAULT_ATOL DSE_REAL(1e-10)
#endif
#define DEFAULT_MAX_STEPS 10000

/* A guarded step has |w| h |F| <= LARGEST_CHANGE: q changes w by no more than that part of |w|. */
#define LARGEST_CHANGE DSE_REAL(0.1)
/* Halvings after which a step is hopeless. */
#define LARGEST_PARTS (1 << 20)

/* The settings live in the filter, not on the stack, which is deep enough below this. */
static enum dse_status adaptive(struct dse_second_order *filter, dse_ode_rhs f, void *context,
                                dse_real span, int count, dse_real *z, dse_real *scratch)
{
    const struct dse_second_order_config *given = filter->config;
    struct dse_rk45_config *config = &filter->integration;
    config->rtol = given->rtol > 0 ? given->rtol : DEFAULT_RTOL;
    config->atol = given->atol > 0 ? given->atol : DEFAULT_ATOL;
    config->max_steps = given->max_steps > 0 ? given->max_steps : DEFAULT_MAX_STEPS;
    const enum dse_status status =
        dse_rk45_integrate(f, context, config, filter->time, filter->time + span, count, z, scratch,
                           &filter->integrated);
    config->h0 = status == DSE_OK ? filter->integrated.h : 0;
    return status;
}

/* A system x' = A x + q(x) that is certified stable cannot gain energy between samples; rounding
 * may, a little. */
static bool has_grown(int guarded, const dse_real *before, const dse_real *after)
{
    const dse_real rounding = (dse_real)(16 * guarded) * DSE_REAL_EPSILON;
    return !(dse_norm2(guarded, after) <= (1 + rounding) * dse_norm2(guarded, before));
}

/* Fixed steps, each divided in 2, 4, .. parts where it is too long for the state at its start. */
static enum dse_status guarded_steps(struct dse_second_order *filter, dse_ode_rhs f, void *context,
                                     bool may_grow, dse_real span, int count, int guarded,
                                     dse_real *z, dse_real *scratch)
{
    const int substeps = filter->config->substeps;
    const int max_steps =
        filter->config->max_steps > 0 ? filter->config->max_steps : DEFAULT_MAX_STEPS;
    const dse_real h = span / (dse_real)substeps;
    dse_real *trial = second_order_piece(&scratch, count);
    int tries = 0;
    for (int step = 0; step < substeps; step++) {
        int parts = 1, done = 0;
        while (done < parts) {
            const dse_real part = h / (dse_real)parts;
            const dse_real t =
                filter->time + ((dse_real)step + (dse_real)done / (dse_real)parts) * h;
            bool good = dse_norm2(filter->nx, z) * part * filter->form <= LARGEST_CHANGE;
            if (good) {
                second_order_copy(count, z, trial);
                const enum dse_status status =
                    dse_rk4_step(f, context, t, part, count, trial, scratch);
                if (status != DSE_OK && status != DSE_ENONFINITE)
                    return status;
                good = status == DSE_OK && (may_grow || !has_grown(guarded, z, trial));
            }
            if (++tries > max_steps || (!good && parts >= LARGEST_PARTS))
                return DSE_ENOCONV;
            if (good) {
                second_order_copy(count, trial, z);
                done++;
            } else {
                parts *= 2;
                done *= 2;
                filter->counts.halved++;
            }
        }
    }
    return DSE_OK;
}

enum dse_status second_order_integrate(struct dse_second_order *filter, dse_ode_rhs f,
                                       void *context, bool may_grow, dse_real span, int count,
                                       int guarded, dse_real *z, dse_real *scratch)
{
    if (filter->config->substeps == 0)
        return adaptive(filter, f, context, span, count, z, scratch);
    return guarded_steps(filter, f, context, may_grow, span, count, guarded, z, scratch);
}
