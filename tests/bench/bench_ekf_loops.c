/* The filter in plain loops of constant length, one copy per size. */
#include <stddef.h>

#include "bench_ekf.h"

#include <math.h>

#define JOIN_(a, b, c) a##b##_##c
#define JOIN(a, b, c)  JOIN_(a, b, c)
#define NAME(what)     JOIN(what, NX, NY)

#ifdef DSE_REAL_IS_float
#define SQRT sqrtf
#else
#define SQRT sqrt
#endif

#define NX 2
#define NY 1
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

const struct contender bench_ekf_loops[5] = {
    {"loops", 2, 1, start_2_1, step_2_1, read_2_1},
    {"loops", 4, 2, start_4_2, step_4_2, read_4_2},
    {"loops", 8, 4, start_8_4, step_8_4, read_8_4},
    {"loops", 15, 6, start_15_6, step_15_6, read_15_6},
    {"loops", 30, 10, start_30_10, step_30_10, read_30_10},
};
