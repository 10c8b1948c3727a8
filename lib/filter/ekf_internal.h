/* What the steps of the extended Kalman filter share. */
#ifndef DSE_FILTER_EKF_INTERNAL_H
#define DSE_FILTER_EKF_INTERNAL_H

#include "dse/ekf.h"

/* The next estimate becomes the estimate: pointers change places, nothing is copied. */
void dse_ekf_commit(struct dse_ekf *ekf);

/* Notes that a step failed; the estimate has not been touched. Returns status. */
enum dse_status dse_ekf_fail(struct dse_ekf *ekf, enum dse_status status);

#endif
