/* Texts of the status and health codes. */
#include "dse/status.h"
#include "dse/health.h"

const char *dse_status_text(enum dse_status status)
{
    switch (status) {
    case DSE_OK:
        return "ok";
    case DSE_EINVAL:
        return "an argument or configuration value is outside its range";
    case DSE_EDIM:
        return "dimensions do not fit each other";
    case DSE_ESTORAGE:
        return "the arena is smaller than the object's storage";
    case DSE_ENONFINITE:
        return "a value is NaN or infinite";
    case DSE_ENOTPD:
        return "a matrix is not positive definite";
    case DSE_ESINGULAR:
        return "a linear system is singular";
    case DSE_ENOCONV:
        return "an iteration did not converge within its bound";
    case DSE_EMODEL:
        return "the model cannot be evaluated at this point";
    case DSE_ENODATA:
        return "there is no valid data to work on";
    case DSE_EFORMAT:
        return "a message does not have the expected form";
    case DSE_EINFEASIBLE:
        return "no point satisfies all constraints";
    }
    return "unknown status";
}

const char *dse_health_text(enum dse_health health)
{
    switch (health) {
    case DSE_HEALTH_INITIALISING:
        return "initialising";
    case DSE_HEALTH_TRACKING:
        return "tracking";
    case DSE_HEALTH_COASTING:
        return "coasting";
    case DSE_HEALTH_REJECTING:
        return "rejecting";
    case DSE_HEALTH_DIVERGED:
        return "diverged";
    case DSE_HEALTH_UNOBSERVABLE:
        return "unobservable";
    case DSE_HEALTH_ALONE:
        return "alone";
    }
    return "unknown health";
}
