/* Dormand and Prince's Runge-Kutta pair of orders 5 and 4 (J. Comput. Appl. Math. 6, 1980) with the
 * PI step control of Hairer, Norsett and Wanner (Solving Ordinary Differential Equations I, II.4
 * and IV.2). The last stage of a step is the first of the next one. */
#include "dse/ode.h"

#include <stddef.h>

#include "dse/math.h"

#define STAGES 7

#define DEFAULT_RTOL      DSE_REAL(1e-6)
#define DEFAULT_ATOL      DSE_REAL(1e-9)
#define DEFAULT_MAX_STEPS 10000

/* Step control: h <- h SAFETY error^-EXPONENT previous_error^MEMORY, within the limits. */
#define SAFETY         DSE_REAL(0.9)
#define MEMORY         DSE_REAL(0.04)
#define EXPONENT       (DSE_REAL(0.2) - DSE_REAL(0.75) * MEMORY)
#define GROW_AT_MOST   10
#define SHRINK_AT_MOST DSE_REAL(0.2)
#define SMALLEST_ERROR DSE_REAL(1e-4) /* in the memory, lest one lucky step rules the next */

static const dse_real c[STAGES] = {
    0, DSE_REAL(1.0 / 5), DSE_REAL(3.0 / 10), DSE_REAL(4.0 / 5), DSE_REAL(8.0 / 9), 1, 1};

/* The last row holds the weights of order 5 as well. */
static const dse_real a[STAGES][STAGES - 1] = {
    {0},
    {DSE_REAL(1.0 / 5)},
    {DSE_REAL(3.0 / 40), DSE_REAL(9.0 / 40)},
    {DSE_REAL(44.0 / 45), DSE_REAL(-56.0 / 15), DSE_REAL(32.0 / 9)},
    {DSE_REAL(19372.0 / 6561), DSE_REAL(-25360.0 / 2187), DSE_REAL(64448.0 / 6561),
     DSE_REAL(-212.0 / 729)},
    {DSE_REAL(9017.0 / 3168), DSE_REAL(-355.0 / 33), DSE_REAL(46732.0 / 5247), DSE_REAL(49.0 / 176),
     DSE_REAL(-5103.0 / 18656)},
    {DSE_REAL(35.0 / 384), 0, DSE_REAL(500.0 / 1113), DSE_REAL(125.0 / 192),
     DSE_REAL(-2187.0 / 6784), DSE_REAL(11.0 / 84)},
};

/* Weights of order 5 minus weights of order 4. */
static const dse_real e[STAGES] = {DSE_REAL(71.0 / 57600),      0,
                                   DSE_REAL(-71.0 / 16695),     DSE_REAL(71.0 / 1920),
                                   DSE_REAL(-17253.0 / 339200), DSE_REAL(22.0 / 525),
                                   DSE_REAL(-1.0 / 40)};

struct run {
    dse_ode_rhs f;
    void *context;
    struct dse_rk45_config config; /* defaults filled in */
    int n;
    dse_real *x;         /* n: where the integration stands */
    dse_real *trial;     /* n: stages, and at last x after the step */
    dse_real *k[STAGES]; /* n each; k[0] = f(t, x) */
};

static void swap(dse_real **p, dse_real **q)
{
    dse_real *r = *p;
    *p = *q;
    *q = r;
}

/* k[0..6] and trial for a step h from t. */
static enum dse_status stages(struct run *run, dse_real t, dse_real h)
{
    for (int s = 1; s < STAGES; s++) {
        for (int j = 0; j < run->n; j++) {
            dse_real sum = 0;
            for (int i = 0; i < s; i++)
                sum += a[s][i] * run->k[i][j];
            run->trial[j] = run->x[j] + h * sum;
        }
        enum dse_status status = run->f(run->context, t + c[s] * h, run->trial, run->k[s]);
        if (status != DSE_OK)
            return status;
    }
    return DSE_OK;
}

static dse_real tolerance(const struct run *run, dse_real x)
{
    return run->config.atol + run->config.rtol * dse_abs(x);
}

/* The largest local error in units of its tolerance; NaN or infinite when something is. */
static dse_real largest_error(const struct run *run, dse_real h)
{
    dse_real largest = 0;
    for (int j = 0; j < run->n; j++) {
        dse_real sum = 0;
        for (int s = 0; s < STAGES; s++)
            sum += e[s] * run->k[s][j];
        dse_real size = dse_max(dse_abs(run->x[j]), dse_abs(run->trial[j]));
        largest = dse_max(largest, dse_abs(h * sum) / tolerance(run, size));
    }
    return largest;
}

/* A tried step: DSE_OK and its error, or why there is none. */
static enum dse_status try_step(struct run *run, dse_real t, dse_real h, dse_real *error)
{
    enum dse_status status = stages(run, t, h);
    if (status != DSE_OK)
        return status;
    *error = largest_error(run, h);
    if (!dse_is_finite(*error) || !dse_all_finite(run->trial, run->n))
        return DSE_ENONFINITE;
    return DSE_OK;
}

/* What to multiply the step by. */
static dse_real step_factor(dse_real error, dse_real previous_error, bool may_grow)
{
    dse_real limit = may_grow ? GROW_AT_MOST : 1;
    if (error == 0)
        return limit;
    dse_real factor = SAFETY * dse_pow(error, -EXPONENT) * dse_pow(previous_error, MEMORY);
    return dse_min(dse_max(factor, SHRINK_AT_MOST), limit);
}

/* A first step that changes x by about a hundredth: 0.01 |x| / |f| in units of the tolerance. */
static dse_real first_step(const struct run *run, dse_real span)
{
    dse_real size = 0, rate = 0;
    for (int j = 0; j < run->n; j++) {
        dse_real unit = tolerance(run, run->x[j]);
        size = dse_max(size, dse_abs(run->x[j]) / unit);
        rate = dse_max(rate, dse_abs(run->k[0][j]) / unit);
    }
    dse_real h = DSE_REAL(0.01) * size / rate;
    return h > 0 && h < span ? h : DSE_REAL(0.01) * span;
}

/* From t0 to t1, or as far as it goes. */
static enum dse_status integrate(struct run *run, dse_real t0, dse_real t1,
                                 struct dse_rk45_result *result)
{
    const dse_real direction = t1 > t0 ? 1 : -1;
    dse_real t = t0, previous_error = SMALLEST_ERROR;
    enum dse_status trouble = DSE_ENOCONV;
    bool may_grow = true;
    for (int tries = 0; tries < run->config.max_steps; tries++) {
        dse_real rest = dse_abs(t1 - t);
        bool last = DSE_REAL(1.01) * result->h >= rest; /* no tiny step at the end */
        dse_real h = last ? rest : result->h;
        if (t + direction * h == t)
            return trouble;
        dse_real error;
        enum dse_status status = try_step(run, t, direction * h, &error);
        if (status != DSE_OK && status != DSE_EMODEL && status != DSE_ENONFINITE)
            return status;
        if (status != DSE_OK || error > 1) {
            dse_real factor = SHRINK_AT_MOST;
            if (status == DSE_OK)
                factor = step_factor(error, 1, false);
            result->h = h * factor;
            result->rejected++;
            trouble = status != DSE_OK ? status : DSE_ENOCONV;
            may_grow = false;
            continue;
        }
        result->steps++;
        swap(&run->x, &run->trial);
        swap(&run->k[0], &run->k[STAGES - 1]);
        dse_real proposal = h * step_factor(error, previous_error, may_grow);
        /* the last step was cut to fit; that is no reason for a smaller one next time */
        result->h = last ? dse_max(proposal, result->h) : proposal;
        if (last)
            return DSE_OK;
        t += direction * h;
        previous_error = dse_max(error, SMALLEST_ERROR);
        if (may_grow) /* two good steps in a row: the trouble is over */
            trouble = DSE_ENOCONV;
        may_grow = true;
    }
    return trouble;
}

/* Fills in the defaults. */
static enum dse_status settle(const struct dse_rk45_config *given, struct dse_rk45_config *config)
{
    *config = given != NULL ? *given : (struct dse_rk45_config){0};
    const dse_real values[] = {config->rtol, config->atol, config->h0};
    for (int i = 0; i < 3; i++)
        if (!dse_is_finite(values[i]) || values[i] < 0)
            return DSE_EINVAL;
    if (config->max_steps < 0)
        return DSE_EINVAL;
    if (config->rtol == 0)
        config->rtol = DEFAULT_RTOL;
    if (config->atol == 0)
        config->atol = DEFAULT_ATOL;
    if (config->max_steps == 0)
        config->max_steps = DEFAULT_MAX_STEPS;
    return DSE_OK;
}

enum dse_status dse_rk45_integrate(dse_ode_rhs f, void *context,
                                   const struct dse_rk45_config *config, dse_real t0, dse_real t1,
                                   int n, dse_real *x, dse_real *scratch,
                                   struct dse_rk45_result *result)
{
    struct dse_rk45_result unwanted;
    if (result == NULL)
        result = &unwanted;
    *result = (struct dse_rk45_result){0};

    struct run run = {.f = f, .context = context, .n = n};
    enum dse_status status = settle(config, &run.config);
    if (status != DSE_OK || n < 1)
        return DSE_EINVAL;
    if (!dse_is_finite(t1 - t0) || !dse_all_finite(x, n))
        return DSE_ENONFINITE;
    result->h = run.config.h0;
    if (t0 == t1)
        return DSE_OK;

    run.x = scratch;
    run.trial = scratch + n;
    for (int s = 0; s < STAGES; s++)
        run.k[s] = scratch + (2 + s) * n;
    for (int j = 0; j < n; j++)
        run.x[j] = x[j];
    status = f(context, t0, run.x, run.k[0]);
    if (status != DSE_OK)
        return status;
    if (!dse_all_finite(run.k[0], n))
        return DSE_ENONFINITE;
    if (result->h == 0)
        result->h = first_step(&run, dse_abs(t1 - t0));

    status = integrate(&run, t0, t1, result);
    if (status == DSE_OK)
        for (int j = 0; j < n; j++)
            x[j] = run.x[j];
    return status;
}
