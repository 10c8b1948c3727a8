/* SUNDIALS' CVODE around the plant's right-hand side.
 *
 * BDF with Newton's method, because chemical plants are stiff: fast reactions and small hold-ups
 * beside slow heat balances. The Newton matrix is dense and comes from the model's own Jacobian
 * where it has one. */
#include <stdlib.h>

#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#include "dse/math.h"
#include "sim/integrator_internal.h"

/* Between two samples. Far more than any sensible sample needs, few enough to end in seconds. */
#define MAX_STEPS 50000

struct sim_cvode {
    struct sim_field *field;
    SUNContext context;
    void *memory;
    N_Vector x;       /* the solution */
    N_Vector atol;    /* absolute tolerance of each state */
    N_Vector rates;   /* dx/dt where the integration failed */
    SUNMatrix newton; /* I - gamma J */
    SUNLinearSolver solver;
    double *jacobian;  /* nx x nx, row-major as the model writes it */
    bool fresh;        /* there is no history of the solution to go on from */
    char message[256]; /* the latest of CVODE itself */
};

/* Positive: recoverable, CVODE tries a smaller step before it gives up. A model that cannot be
 * evaluated at a trial point may well be defined on the solution itself. */
static int rhs(double t, N_Vector x, N_Vector dx, void *user)
{
    struct sim_cvode *cvode = user;
    enum dse_status status =
        sim_field_rhs(cvode->field, t, N_VGetArrayPointer(x), N_VGetArrayPointer(dx));
    return status == DSE_OK ? 0 : 1;
}

/* J = df/dx; the held noise has no part in it. SUNDIALS stores columns. */
static int jacobian(double t, N_Vector x, N_Vector dx, SUNMatrix J, void *user, N_Vector tmp1,
                    N_Vector tmp2, N_Vector tmp3)
{
    (void)dx, (void)tmp1, (void)tmp2, (void)tmp3;
    struct sim_cvode *cvode = user;
    const struct dse_model *model = &cvode->field->model;
    const double *u = sim_field_inputs(cvode->field, t);
    if (model->dfdx(model, t, N_VGetArrayPointer(x), u, cvode->jacobian) != DSE_OK ||
        !dse_all_finite(cvode->jacobian, model->nx * model->nx))
        return 1;
    for (int j = 0; j < model->nx; j++)
        for (int i = 0; i < model->nx; i++)
            SM_ELEMENT_D(J, i, j) = cvode->jacobian[i * model->nx + j];
    return 0;
}

/* CVODE would write to stderr; its message becomes part of the reason instead. */
static void keep_message(int code, const char *module, const char *function, char *message,
                         void *user)
{
    (void)code, (void)module, (void)function;
    struct sim_cvode *cvode = user;
    cvode->message[0] = '\0';
    sim_reason(cvode->message, (int)sizeof cvode->message, "%s", message);
}

static bool allocate(struct sim_cvode *cvode, int nx)
{
    if (SUNContext_Create(NULL, &cvode->context) != 0)
        return false;
    cvode->x = N_VNew_Serial(nx, cvode->context);
    cvode->atol = N_VNew_Serial(nx, cvode->context);
    cvode->rates = N_VNew_Serial(nx, cvode->context);
    cvode->newton = SUNDenseMatrix(nx, nx, cvode->context);
    cvode->jacobian = calloc((size_t)nx * (size_t)nx, sizeof *cvode->jacobian);
    cvode->memory = CVodeCreate(CV_BDF, cvode->context);
    if (cvode->x == NULL || cvode->atol == NULL || cvode->rates == NULL || cvode->newton == NULL ||
        cvode->jacobian == NULL || cvode->memory == NULL)
        return false;
    cvode->solver = SUNLinSol_Dense(cvode->x, cvode->newton, cvode->context);
    return cvode->solver != NULL;
}

static bool configure(struct sim_cvode *cvode, double rtol)
{
    void *memory = cvode->memory;
    return CVodeSetErrHandlerFn(memory, keep_message, cvode) == CV_SUCCESS &&
           CVodeInit(memory, rhs, 0, cvode->x) == CV_SUCCESS &&
           CVodeSVtolerances(memory, rtol, cvode->atol) == CV_SUCCESS &&
           CVodeSetUserData(memory, cvode) == CV_SUCCESS &&
           CVodeSetMaxNumSteps(memory, MAX_STEPS) == CV_SUCCESS &&
           CVodeSetLinearSolver(memory, cvode->solver, cvode->newton) == CVLS_SUCCESS &&
           (cvode->field->model.dfdx == NULL || CVodeSetJacFn(memory, jacobian) == CVLS_SUCCESS);
}

struct sim_cvode *sim_cvode_create(struct sim_field *field, const double *x0, double rtol,
                                   double atol)
{
    struct sim_cvode *cvode = calloc(1, sizeof *cvode);
    if (cvode == NULL)
        return NULL;
    cvode->field = field;
    cvode->fresh = true;
    int nx = field->model.nx;
    if (!allocate(cvode, nx)) {
        sim_cvode_destroy(cvode);
        return NULL;
    }
    for (int j = 0; j < nx; j++) {
        NV_Ith_S(cvode->x, j) = x0[j];
        NV_Ith_S(cvode->atol, j) = atol * field->plant->states[j].scale;
    }
    if (!configure(cvode, rtol)) {
        sim_cvode_destroy(cvode);
        return NULL;
    }
    return cvode;
}

void sim_cvode_destroy(struct sim_cvode *cvode)
{
    if (cvode == NULL)
        return;
    if (cvode->memory != NULL)
        CVodeFree(&cvode->memory);
    if (cvode->solver != NULL)
        SUNLinSolFree(cvode->solver);
    if (cvode->newton != NULL)
        SUNMatDestroy(cvode->newton);
    if (cvode->x != NULL)
        N_VDestroy(cvode->x);
    if (cvode->atol != NULL)
        N_VDestroy(cvode->atol);
    if (cvode->rates != NULL)
        N_VDestroy(cvode->rates);
    if (cvode->context != NULL)
        SUNContext_Free(&cvode->context);
    free(cvode->jacobian);
    free(cvode);
}

/* Where CVODE got stuck, the state that changes fastest relative to its scale is the one to look
 * at; -1 when the plant stands still or cannot be evaluated there. */
static int fastest_state(struct sim_cvode *cvode, double t)
{
    const struct dse_plant *plant = cvode->field->plant;
    const double *dx = N_VGetArrayPointer(cvode->rates);
    if (rhs(t, cvode->x, cvode->rates, cvode) != 0)
        return -1;
    int fastest = -1;
    double most = 0;
    for (int j = 0; j < plant->nx; j++) {
        double rate = dse_abs(dx[j]) / plant->states[j].scale;
        if (rate > most) {
            most = rate;
            fastest = j;
        }
    }
    return fastest;
}

/* x and t are where CVODE got stuck. A fault of the right-hand side before t was overcome and is
 * not the cause. */
static void explain(struct sim_cvode *cvode, double t, char *reason, int reason_size)
{
    const struct sim_field *field = cvode->field;
    if (field->fault != DSE_OK && field->fault_time >= t) {
        sim_field_explain(field, reason, reason_size);
    } else {
        int state = fastest_state(cvode, t);
        if (state >= 0)
            sim_reason(reason, reason_size, "; the state that changes fastest is %s",
                       field->plant->states[state].name);
    }
    sim_reason(reason, reason_size, " (CVODE: %s)", cvode->message);
}

/* Forgets the history and starts at x(t). */
static int reinitialise(struct sim_cvode *cvode, double t, const double *x)
{
    for (int j = 0; j < cvode->field->model.nx; j++)
        NV_Ith_S(cvode->x, j) = x[j];
    cvode->fresh = false;
    return CVodeReInit(cvode->memory, t, cvode->x);
}

bool sim_cvode_integrate(struct sim_cvode *cvode, bool jumps, double t, double t1, double *x,
                         char *reason, int reason_size)
{
    double reached = t;
    int flag = CV_SUCCESS;
    cvode->field->fault = DSE_OK;
    cvode->message[0] = '\0';
    if (jumps || cvode->fresh)
        flag = reinitialise(cvode, t, x);
    if (flag == CV_SUCCESS && jumps)
        flag = CVodeSetStopTime(cvode->memory, t1);
    if (flag == CV_SUCCESS)
        flag = CVode(cvode->memory, t1, cvode->x, &reached, CV_NORMAL);
    /* a stop time of the call before, met again where this one begins */
    if (flag == CV_TSTOP_RETURN && reached < t1)
        flag = CVode(cvode->memory, t1, cvode->x, &reached, CV_NORMAL);
    if (flag < 0) {
        cvode->fresh = true;
        explain(cvode, reached, reason, reason_size);
        return false;
    }
    for (int j = 0; j < cvode->field->model.nx; j++)
        x[j] = NV_Ith_S(cvode->x, j);
    return true;
}
