/* Window QP on OSQP: what set-up and solution share. */
#ifndef DSE_MHE_WINDOW_QP_OSQP_INTERNAL_H
#define DSE_MHE_WINDOW_QP_OSQP_INTERNAL_H

#include <osqp.h>

#include "dse/window_qp_osqp.h"

/* The values of S P S in the order of its columns, upper triangle, all entries of the blocks. */
void window_qp_osqp_write_P(const struct dse_window_qp_osqp *osqp,
                            const struct dse_window_qp_problem *problem, OSQPFloat *values);

#endif
