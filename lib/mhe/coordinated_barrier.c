#include "coordinated_internal.h"
enum dse_status mhe_barrier_solve(struct dse_mhe_local *local, const dse_real *h)
{
    (void)local;
    (void)h;
    return DSE_ENOCONV;
}
