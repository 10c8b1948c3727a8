/* Shared by the model of the three tanks and its normal form: see three_tank.c. */
#ifndef DSE_THREE_TANK_INTERNAL_H
#define DSE_THREE_TANK_INTERNAL_H

#include "dse/normal_form.h"
#include "dse/real.h"

/* Block by block: tank 1, tank 2, tank 3. */
enum { X1, X2, X3, X5, X4, STATES };
enum { U1, U2, INPUTS };
enum { Y1, Y2, Y3, OUTPUTS };

/* Derived constants. All members are dse_real because it lives in the plant's prepared reals. */
struct dse_tanks {
    dse_real p[2];        /* tank 1 to 2, tank 3 to 2: cm^0.5/h */
    dse_real d[3];        /* cm^0.5/h */
    dse_real b[2];        /* cm/h per unit of input */
    dse_real reverse;     /* 0 or 1 */
    dse_real upper[2][2]; /* as p: the middle and the top pipe of each side, 0 where it is shut */
    dse_real height[2];   /* of middle and top pipes, cm */
    dse_real is_open;     /* 0 or 1: some middle or top pipe is */
};

#define DSE_TANKS_SIZE ((int)(sizeof(struct dse_tanks) / sizeof(dse_real)))

/* cm: square roots of the estimators' model are taken at no less, those of the normal form at no
 * more. */
#define DSE_TANKS_LOWEST  DSE_REAL(0.01)
#define DSE_TANKS_HIGHEST DSE_REAL(100)

/* Flows (cm/h) through the middle and top pipes from tank 1 and from tank 3 to tank 2, at levels
 * x (STATES). */
void dse_three_tank_upper_flows(const struct dse_tanks *tanks, const dse_real *x, dse_real *flow);
/* Adds what they do to the rows X1, X3 and X5 of df/dx. */
void dse_three_tank_upper_slopes(const struct dse_tanks *tanks, const dse_real *x, dse_real *F);

/* Without maps (encode and the others are NULL) where the flow between the tanks does not tell the
 * difference of their levels: a bottom pipe is shut, or one above it open. */
void dse_three_tank_normal_form(const dse_real *prepared, struct dse_normal_form *form);

#endif
