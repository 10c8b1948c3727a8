/* Solves a sequence of bounded windows on the generated workspace `probe` and reports the states,
 * once with the workspace's active set and once by the library's own search. */
#include "dse/window_qp.h"
#include "dse/window_qp_osqp.h"
#include "probe.h"
#include "report.h"

enum { NZ = probe_nz, H = probe_stages, ALL = NZ * H, WINDOWS = 4 };

static dse_real memory[2][DSE_WINDOW_QP_STORAGE(NZ, NZ, H, ALL)];
static dse_real c[ALL], lower[ALL], upper[ALL], row_lower[ALL], row_upper[ALL];

/* Uniform on (-1, 1). */
static dse_real uniform(void)
{
    static unsigned state = 12345;
    state = state * 1664525u + 1013904223u;
    return (dse_real)(int)(state >> 8 & 0xffff) / DSE_REAL(32768.0) - 1;
}

/* c = P x, so that x without bounds is of the order of 1; bounds cut a part of that. */
static void make_window(void)
{
    dse_real x[ALL];
    for (int i = 0; i < ALL; i++) {
        x[i] = uniform();
        lower[i] = i % NZ == 0 ? DSE_REAL(-0.3) : -DSE_REAL_MAX;
        upper[i] = DSE_REAL(0.4);
        row_lower[i] = DSE_REAL(-0.2);
        row_upper[i] = i % 2 == 0 ? DSE_REAL(0.2) : DSE_REAL_MAX;
    }
    for (int j = 0; j < H; j++) {
        for (int i = 0; i < NZ; i++) {
            dse_real sum = 0;
            for (int p = 0; p < NZ; p++) {
                sum += probe_diagonal[j][i * NZ + p] * x[j * NZ + p];
                if (j > 0)
                    sum += probe_below[j - 1][i * NZ + p] * x[(j - 1) * NZ + p];
                if (j + 1 < H)
                    sum += probe_below[j][p * NZ + i] * x[(j + 1) * NZ + p];
            }
            c[j * NZ + i] = sum;
        }
    }
}

int main(void)
{
    static const struct dse_window_qp_config config[2] = {{.nz = NZ,
                                                           .nr = NZ,
                                                           .stages = H,
                                                           .max_passes = -1,
                                                           .max_steps = -1,
                                                           .backend = &probe_backend},
                                                          {.nz = NZ, .nr = NZ, .stages = H}};
    static struct dse_window_qp qp[2];
    const struct dse_window_qp_problem problem = {.stages = H,
                                                  .diagonal = probe_diagonal,
                                                  .below = probe_below,
                                                  .c = c,
                                                  .bounds = {.lower = lower,
                                                             .upper = upper,
                                                             .E = probe_E,
                                                             .row_lower = row_lower,
                                                             .row_upper = row_upper}};
    for (int which = 0; which < 2; which++) {
        struct dse_arena arena;
        dse_arena_init(&arena, memory[which], DSE_WINDOW_QP_STORAGE(NZ, NZ, H, ALL));
        report_check("init", dse_window_qp_init(&qp[which], &config[which], &arena) == DSE_OK);
        report_check("factor", dse_window_qp_factor(&qp[which], &problem, H - 1) == DSE_OK);
    }
    for (int k = 0; k < WINDOWS; k++) {
        make_window();
        for (int which = 0; which < 2; which++) {
            report_check("solve", dse_window_qp_solve(&qp[which], &problem) == DSE_OK);
            report_vector(which == 0 ? "osqp" : "own", ALL, dse_window_qp_z(&qp[which]));
        }
        report_int("path", (int)qp[0].path);
        report_int("active", qp[0].set.count);
    }
    return report_verdict();
}
