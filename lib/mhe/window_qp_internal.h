/* Window QP: what its parts share. */
#ifndef DSE_MHE_WINDOW_QP_INTERNAL_H
#define DSE_MHE_WINDOW_QP_INTERNAL_H

#include "dse/window_qp.h"

/* ---- factor (window_qp_factor.c) ---- */

/* dse_active_set_apply with the solver as context. */
enum dse_status window_qp_apply(void *context, int count, int newest, dse_real *X);

/* ---- certificate (window_qp_certificate.c); leaves P z - c + N'y in qp->residual ---- */

/* The largest of the three parts. */
dse_real window_qp_worst(const struct dse_window_qp_certificate *certificate);

#endif
