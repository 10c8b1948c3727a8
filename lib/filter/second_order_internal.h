/* What the parts of the second-order filter share with each other and with its distributed form. */
#ifndef DSE_SECOND_ORDER_INTERNAL_H
#define DSE_SECOND_ORDER_INTERNAL_H

#include <stddef.h>

#include "dse/second_order.h"

/* The next `count` reals of a scratch. */
static inline dse_real *second_order_piece(dse_real **scratch, int count)
{
    dse_real *piece = *scratch;
    *scratch += count;
    return piece;
}

static inline void second_order_copy(int count, const dse_real *from, dse_real *to)
{
    for (int i = 0; i < count; i++)
        to[i] = from[i];
}

/* Z (n x n) with S = Z'Z for a positive semidefinite S. d: n reals of scratch. DSE_ENOTPD,
 * DSE_ENONFINITE. */
enum dse_status second_order_root(int n, const dse_real *S, dse_real *Z, dse_real *d);

/* Z (n x n) with Z'Z = A A', A n x m, m >= n, overwritten. */
void second_order_array(int n, int m, dse_real *A, dse_real *Z);

/* z (count) from t to t + span; its first nx reals are a state of the plant, the squares of its
 * first `guarded` ones cannot grow when the filter is bounded. scratch: DSE_RK45_SCRATCH(count) and
 * nx squares. DSE_ENONFINITE, DSE_ENOCONV. */
enum dse_status second_order_integrate(struct dse_second_order *filter, dse_ode_rhs f,
                                       void *context, bool may_grow, dse_real span, int count,
                                       int guarded, dse_real *z, dse_real *scratch);

/* DSE_SECOND_ORDER_UNSCENTED: 2 nx points (x nx) around the estimate, and x_next, Z_next from where
 * they are a span later. scratch: 5 nx squares and nx. */
void second_order_place_points(struct dse_second_order *filter, dse_real *points);
enum dse_status second_order_collect_points(struct dse_second_order *filter, dse_real span,
                                            const dse_real *points, dse_real *scratch);

/* Takes a measurement: y, has, innovation and the counts, after the gate on the present S. */
void second_order_take(struct dse_second_order *filter, const struct dse_measurement *measurement);

/* x_next, Z_next from the state x, the covariance Z'Z (nx x nx) and the measurement y of the
 * channels that `has` says. DSE_ENONFINITE. */
enum dse_status second_order_correct(struct dse_second_order *filter, const dse_real *Z,
                                     const dse_real *y);

/* The same from information u (nx), Y (nx x nx, symmetric) and the present Z. DSE_ENOTPD: Y is so
 * far from semidefinite that I + Z Y Z' is not positive; DSE_ENONFINITE. */
enum dse_status second_order_inform(struct dse_second_order *filter, const dse_real *u,
                                    const dse_real *Y);

/* u (nx) = C'R^-1 y, Y (nx x nx) = C'R^-1 C of the channels that `has` says. */
void second_order_information(struct dse_second_order *filter, dse_real *u, dse_real *Y);

/* Exchanges x, Z for x_next, Z_next; a second time exchanges them back. */
void second_order_exchange(struct dse_second_order *filter);

#endif
