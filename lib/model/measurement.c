#include "dse/model.h"

#include <stddef.h>

#include "dse/math.h"

bool dse_measurement_has(const struct dse_measurement *measurement, int j)
{
    if (measurement->valid != NULL && !measurement->valid[j])
        return false;
    return dse_is_finite(measurement->y[j]);
}
