/* Whether an estimate may be trusted: every estimator says so with each estimate. */
#ifndef DSE_HEALTH_H
#define DSE_HEALTH_H

enum dse_health {
    DSE_HEALTH_INITIALISING = 0, /* too few data since the start for an estimate of its own */
    DSE_HEALTH_TRACKING = 1,     /* normal operation */
    DSE_HEALTH_COASTING = 2,     /* predicting without data of its own */
    DSE_HEALTH_REJECTING = 3,    /* data come, but were refused by a gate or check in this sample */
    DSE_HEALTH_DIVERGED = 4,     /* not finite or failed its own check; the last estimate is held */
    DSE_HEALTH_UNOBSERVABLE = 5, /* the data at hand cannot determine the state */
    DSE_HEALTH_ALONE = 6 /* from its own data only: those that it works with are not there */
};

/* The name used in tables and reports ("tracking"), never NULL. */
const char *dse_health_text(enum dse_health health);

#endif
