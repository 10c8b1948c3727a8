/* What the plant sep3 makes of its parameters, and its equations. */
#ifndef DSE_SEP3_INTERNAL_H
#define DSE_SEP3_INTERNAL_H

#include "dse/model.h"
#include "dse/real.h"

enum { DSE_SEP3_NX = 9, DSE_SEP3_NU = 3, DSE_SEP3_NY = 3 };

/* All members are dse_real because the structure lives in the plant's prepared reals. Flows by
 * volume in 1/h. */
struct dse_sep3 {
    dse_real feed_1, recycle_1;      /* F10/V1, Fr/V1 */
    dse_real from_1, feed_2;         /* F1/V2, F20/V2 */
    dse_real from_2, overhead_3;     /* F2/V3, (Fr + Fp)/V3 */
    dse_real T_feed[2];              /* K */
    dse_real xA_feed[2], xB_feed[2]; /* kg/kg */
    dse_real k[2], s[2];             /* rate constants, 1/h; E/R, K */
    dse_real g[2];                   /* heat of reaction -dH/(cp MWr), K */
    dse_real a[3];                   /* relative volatilities of A, B, C */
    dse_real evaporation[3];         /* (Fr + Fp) dHv/(cp MWv V3), K/h */
    dse_real heat[3];                /* 1/(rho cp V), K/kJ */
};

#define DSE_SEP3_SIZE ((int)(sizeof(struct dse_sep3) / sizeof(dse_real)))

/* The model over a prepared struct dse_sep3. */
void dse_sep3_model(const dse_real *prepared, struct dse_model *model);

#endif
