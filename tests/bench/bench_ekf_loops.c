/* The filter in plain loops of constant length, one copy per size and form of the update. */
#include <stddef.h>

#include "bench_ekf.h"

#include <math.h>

#define JOIN_(a, b, c, d) a##b##_##c##_##d
#define JOIN(a, b, c, d)  JOIN_(a, b, c, d)
#define NAME(what)        JOIN(what, NX, NY, JOSEPH)

#ifdef DSE_REAL_IS_float
#define SQRT sqrtf
#else
#define SQRT sqrt
#endif

#define JOSEPH 0
#define NX     2
#define NY     1
#include "bench_ekf_loops_body.h"
#undef NX
#undef NY
#define NX 4
#define NY 2
#include "bench_ekf_loops_body.h"
#undef NX
#undef NY
#define NX 8
#define NY 4
#include "bench_ekf_loops_body.h"
#undef NX
#undef NY
#define NX 15
#define NY 6
#include "bench_ekf_loops_body.h"
#undef NX
#undef NY
#define NX 30
#define NY 10
#include "bench_ekf_loops_body.h"
#undef NX
#undef NY
#undef JOSEPH

#define JOSEPH 1
#define NX     2
#define NY     1
#include "bench_ekf_loops_body.h"
#undef NX
#undef NY
#define NX 4
#define NY 2
#include "bench_ekf_loops_body.h"
#undef NX
#undef NY
#define NX 8
#define NY 4
#include "bench_ekf_loops_body.h"
#undef NX
#undef NY
#define NX 15
#define NY 6
#include "bench_ekf_loops_body.h"
#undef NX
#undef NY
#define NX 30
#define NY 10
#include "bench_ekf_loops_body.h"
#undef NX
#undef NY
#undef JOSEPH

#define ENTRY(name, nx, ny, joseph)                                                                \
    {                                                                                              \
        name, nx, ny, start_##nx##_##ny##_##joseph, step_##nx##_##ny##_##joseph,                   \
            read_##nx##_##ny##_##joseph                                                            \
    }

const struct contender bench_ekf_loops[5] = {
    ENTRY("loops", 2, 1, 0),  ENTRY("loops", 4, 2, 0),   ENTRY("loops", 8, 4, 0),
    ENTRY("loops", 15, 6, 0), ENTRY("loops", 30, 10, 0),
};
const struct contender bench_ekf_loops_joseph[5] = {
    ENTRY("loops J", 2, 1, 1),  ENTRY("loops J", 4, 2, 1),   ENTRY("loops J", 8, 4, 1),
    ENTRY("loops J", 15, 6, 1), ENTRY("loops J", 30, 10, 1),
};
