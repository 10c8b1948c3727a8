/* The middle and top pipes between the tanks (Fig 6.1). Water stands in a pipe at height H on a
 * side whose level is above it, so that with a' = max(a - H, 0) of the outer tank and b' of tank 2
 *
 *     q = p sgn(a' - b') sqrt |a' - b'|
 *
 * into tank 2, and nothing while both levels are below. Below a difference of 0.01 cm the root is a
 * straight line to 0, whose slope is that bound's: a Jacobian stays finite. */
#include "dse/math.h"
#include "three_tank_internal.h"

static const int outer[2] = {X1, X5};

static dse_real above(dse_real level, dse_real height)
{
    return level > height ? level - height : 0;
}

static dse_real root(dse_real difference)
{
    const dse_real size = dse_abs(difference);
    const dse_real flow =
        size < DSE_TANKS_LOWEST ? size / dse_sqrt(DSE_TANKS_LOWEST) : dse_sqrt(size);
    return difference < 0 ? -flow : flow;
}

static dse_real root_slope(dse_real difference)
{
    const dse_real size = dse_abs(difference);
    return size < DSE_TANKS_LOWEST ? 1 / dse_sqrt(DSE_TANKS_LOWEST)
                                   : DSE_REAL(0.5) / dse_sqrt(size);
}

void dse_three_tank_upper_flows(const struct dse_tanks *tanks, const dse_real *x, dse_real *flow)
{
    for (int side = 0; side < 2; side++) {
        flow[side] = 0;
        for (int h = 0; h < 2; h++) {
            const dse_real height = tanks->height[h];
            flow[side] +=
                tanks->upper[side][h] * root(above(x[outer[side]], height) - above(x[X3], height));
        }
    }
}

void dse_three_tank_upper_slopes(const struct dse_tanks *tanks, const dse_real *x, dse_real *F)
{
    for (int side = 0; side < 2; side++) {
        const int o = outer[side];
        for (int h = 0; h < 2; h++) {
            const dse_real height = tanks->height[h];
            const dse_real slope =
                tanks->upper[side][h] * root_slope(above(x[o], height) - above(x[X3], height));
            const dse_real by_outer = x[o] > height ? slope : 0;
            const dse_real by_middle = x[X3] > height ? slope : 0;
            F[o * STATES + o] -= by_outer;
            F[o * STATES + X3] += by_middle;
            F[X3 * STATES + o] += by_outer;
            F[X3 * STATES + X3] -= by_middle;
        }
    }
}
