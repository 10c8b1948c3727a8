/* What a fallible function of the library answers. A step that fails leaves the estimate as it
 * was before the call. */
#ifndef DSE_STATUS_H
#define DSE_STATUS_H

enum dse_status {
    DSE_OK = 0,
    DSE_EINVAL = -1,      /* an argument or a configuration value is outside its documented range */
    DSE_EDIM = -2,        /* dimensions do not fit each other */
    DSE_ESTORAGE = -3,    /* the arena is smaller than the object's DSE_..._STORAGE */
    DSE_ENONFINITE = -4,  /* an input or a result is NaN or infinite */
    DSE_ENOTPD = -5,      /* a matrix that has to be positive definite is not */
    DSE_ESINGULAR = -6,   /* a linear system has no unique solution */
    DSE_ENOCONV = -7,     /* an iteration did not converge within its bound */
    DSE_EMODEL = -8,      /* a model function could not be evaluated at this point */
    DSE_ENODATA = -9,     /* there is nothing to work on: no valid measurement, no message */
    DSE_EFORMAT = -10,    /* bytes of a message do not have the expected form */
    DSE_EINFEASIBLE = -11 /* no point satisfies all constraints */
};

/* One line of English about `status`, never NULL. */
const char *dse_status_text(enum dse_status status);

#endif
