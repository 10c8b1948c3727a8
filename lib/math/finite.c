#include "dse/math.h"

bool dse_all_finite(const dse_real *x, int n)
{
    for (int i = 0; i < n; i++)
        if (!dse_is_finite(x[i]))
            return false;
    return true;
}
