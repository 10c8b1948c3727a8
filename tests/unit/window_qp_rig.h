/* Random window QPs, and a judge of their solutions that shares nothing with the solver: all terms
 * of the optimality conditions, assembled densely. */
#ifndef WINDOW_QP_RIG_H
#define WINDOW_QP_RIG_H

#include <math.h>
#include <stdbool.h>

#include "dse/math.h"
#include "dse/window_qp.h"
#include "near.h"
#include "random_matrix.h"

#define NZ_MAX 5
#define H_MAX  6
#define Z_MAX  (NZ_MAX * H_MAX)
#define K_MAX  (2 * Z_MAX)
#define NONE   DSE_REAL_MAX

struct rig {
    int nz, nr, H;
    dse_real diagonal_blocks[H_MAX][NZ_MAX * NZ_MAX], below_blocks[H_MAX][NZ_MAX * NZ_MAX];
    const dse_real *diagonal[H_MAX], *below[H_MAX];
    dse_real c[Z_MAX], lower[Z_MAX], upper[Z_MAX];
    dse_real E[NZ_MAX * NZ_MAX], F[NZ_MAX * NZ_MAX];
    dse_real row_lower[Z_MAX], row_upper[Z_MAX];
    struct dse_window_qp_problem problem;
};

static dse_real rig_memory[DSE_WINDOW_QP_STORAGE(NZ_MAX, NZ_MAX, H_MAX, Z_MAX)];

/* 0 .. n - 1. */
static inline int rig_choose(int n)
{
    const int k = (int)((0.5 + 0.5 * (double)uniform()) * n);
    return k < n ? k : n - 1;
}

/* P += floor I + sum_j G_j'G_j, G_j touching two stages. */
static inline void rig_fill_P(struct rig *rig, dse_real floor)
{
    const int nz = rig->nz, H = rig->H;
    for (int j = 0; j < H; j++) {
        for (int i = 0; i < nz * nz; i++) {
            rig->diagonal_blocks[j][i] = i / nz == i % nz ? floor : 0;
            rig->below_blocks[j][i] = 0;
        }
        rig->diagonal[j] = rig->diagonal_blocks[j];
        rig->below[j] = rig->below_blocks[j];
    }
    for (int j = 0; j + 1 < H; j++) {
        dse_real G0[NZ_MAX * NZ_MAX], G1[NZ_MAX * NZ_MAX];
        fill(nz * nz, G0);
        fill(nz * nz, G1);
        for (int a = 0; a < nz; a++) {
            for (int b = 0; b < nz; b++) {
                for (int p = 0; p < nz; p++) {
                    rig->diagonal_blocks[j][a * nz + b] += G0[p * nz + a] * G0[p * nz + b];
                    rig->diagonal_blocks[j + 1][a * nz + b] += G1[p * nz + a] * G1[p * nz + b];
                    rig->below_blocks[j][a * nz + b] += G1[p * nz + a] * G0[p * nz + b];
                }
            }
        }
    }
}

/* A random problem that has feasible points: the bounds are made around one. `percent` of the
 * constraints are bounded, on one side or on both; one in eight of those is an equality. */
static inline void rig_make(struct rig *rig, int nz, int nr, int H, int percent, bool identity)
{
    *rig = (struct rig){.nz = nz, .nr = nr, .H = H};
    rig_fill_P(rig, DSE_REAL(0.1));
    fill(nr * nz, rig->E);
    fill(nr * nz, rig->F);
    for (int i = 0; identity && i < nr * nz; i++)
        rig->F[i] = i / nz == i % nz;
    dse_real inside[Z_MAX];
    fill(nz * H, inside);
    for (int i = 0; i < nz * H; i++)
        rig->c[i] = 5 * uniform();
    for (int k = 0; k < (nz + nr) * H - nr; k++) {
        const int j = k / (nz + nr), i = k % (nz + nr);
        dse_real value = inside[j * nz + (i < nz ? i : 0)];
        if (i >= nz) {
            value = 0;
            for (int p = 0; p < nz; p++)
                value += rig->E[(i - nz) * nz + p] * inside[j * nz + p] +
                         rig->F[(i - nz) * nz + p] * inside[(j + 1) * nz + p];
        }
        const bool bounded = rig_choose(100) < percent;
        const int kind = rig_choose(8);
        dse_real *lower = i < nz ? &rig->lower[j * nz + i] : &rig->row_lower[j * nr + i - nz];
        dse_real *upper = i < nz ? &rig->upper[j * nz + i] : &rig->row_upper[j * nr + i - nz];
        *lower = !bounded || kind == 1 ? -NONE : value - dse_abs(uniform());
        *upper = !bounded || kind == 2 ? NONE : value + dse_abs(uniform());
        if (bounded && kind == 0 && i < nz)
            *lower = *upper = value;
    }
    rig->problem = (struct dse_window_qp_problem){
        .stages = H, .diagonal = rig->diagonal, .below = rig->below, .c = rig->c};
    rig->problem.bounds = (struct dse_window_bounds){
        rig->lower, rig->upper, rig->E, identity ? NULL : rig->F, rig->row_lower, rig->row_upper};
}

static inline enum dse_status rig_start(struct dse_window_qp *qp,
                                        const struct dse_window_qp_config *config)
{
    struct dse_arena arena;
    dse_arena_init(&arena, rig_memory, (int)(sizeof rig_memory / sizeof rig_memory[0]));
    return dse_window_qp_init(qp, config, &arena);
}

static inline void rig_solve(struct dse_window_qp *qp, const struct rig *rig)
{
    assert_int_equal(dse_window_qp_factor(qp, &rig->problem, rig->H - 1), DSE_OK);
    assert_int_equal(dse_window_qp_solve(qp, &rig->problem), DSE_OK);
}

/* Normal of constraint k, densely. */
static inline void rig_normal(const struct rig *rig, int k, double *n)
{
    const int nz = rig->nz, stride = nz + rig->nr, j = k / stride, i = k % stride;
    for (int p = 0; p < nz * rig->H; p++)
        n[p] = 0;
    if (i < nz) {
        n[j * nz + i] = 1;
        return;
    }
    for (int p = 0; p < nz; p++) {
        n[j * nz + p] = (double)rig->E[(i - nz) * nz + p];
        n[(j + 1) * nz + p] = (double)rig->F[(i - nz) * nz + p];
    }
}

/* P z, densely. */
static inline void rig_multiply(const struct rig *rig, const double *z, double *Pz)
{
    const int nz = rig->nz;
    for (int j = 0; j < rig->H; j++) {
        for (int a = 0; a < nz; a++) {
            double sum = 0;
            for (int b = 0; b < nz; b++) {
                sum += (double)rig->diagonal_blocks[j][a * nz + b] * z[j * nz + b];
                if (j > 0)
                    sum += (double)rig->below_blocks[j - 1][a * nz + b] * z[(j - 1) * nz + b];
                if (j + 1 < rig->H)
                    sum += (double)rig->below_blocks[j][b * nz + a] * z[(j + 1) * nz + b];
            }
            Pz[j * nz + a] = sum;
        }
    }
}

/* P z - c + N'y = 0; bounds hold; y only where a bound is met, with its sign. Sufficient for the
 * optimum of a strictly convex problem. */
static inline void rig_assert_optimal(const struct rig *rig, const struct dse_window_qp *qp,
                                      double tolerance)
{
    const int all = rig->nz * rig->H, stride = rig->nz + rig->nr;
    double z[Z_MAX] = {0}, g[Z_MAX] = {0}, n[Z_MAX] = {0};
    for (int i = 0; i < all; i++)
        z[i] = (double)dse_window_qp_z(qp)[i];
    rig_multiply(rig, z, g);
    for (int i = 0; i < all; i++)
        g[i] -= (double)rig->c[i];
    for (int k = 0; k < stride * rig->H - rig->nr; k++) {
        const int j = k / stride, i = k % stride, nz = rig->nz;
        const bool box = i < nz;
        const double lower =
            (double)(box ? rig->lower[j * nz + i] : rig->row_lower[j * rig->nr + i - nz]);
        const double upper =
            (double)(box ? rig->upper[j * nz + i] : rig->row_upper[j * rig->nr + i - nz]);
        const double y = (double)dse_window_qp_multipliers(qp)[k];
        double value = 0;
        rig_normal(rig, k, n);
        for (int p = 0; p < all; p++) {
            value += n[p] * z[p];
            g[p] += n[p] * y;
        }
        assert_true(value >= lower - tolerance && value <= upper + tolerance);
        if (y > 0)
            assert_true(fabs(value - upper) <= tolerance);
        if (y < 0)
            assert_true(fabs(value - lower) <= tolerance);
        if (y != 0)
            assert_true(dse_window_qp_side(qp, k) != 0);
    }
    for (int i = 0; i < all; i++)
        assert_true(fabs(g[i]) <= 20 * tolerance);
}

#endif
