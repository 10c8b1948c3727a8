#include "coordination_plant.h"

#include <string.h>

#include "dse/linalg.h"
#include "random_matrix.h"

static void set_block(struct coordination_plant *plant, int i, int l, const dse_real *block)
{
    for (int e = 0; e < PLANT_BLOCK; e++)
        plant->A[(i * PLANT_NX + e / PLANT_NX) * PLANT_N + l * PLANT_NX + e % PLANT_NX] = block[e];
}

static void make_subsystem(struct coordination_plant *plant, int i, dse_real coupling)
{
    dse_real block[PLANT_BLOCK];
    /* damped, and observable from the first state */
    const dse_real A[PLANT_BLOCK] = {
        DSE_REAL(0.8) + DSE_REAL(0.1) * uniform(), DSE_REAL(0.4) + DSE_REAL(0.2) * uniform(),
        DSE_REAL(0.2) * uniform(), DSE_REAL(0.7) + DSE_REAL(0.1) * uniform()};
    memcpy(plant->A_ii[i], A, sizeof A);
    set_block(plant, i, i, A);
    for (int l = i - 1; l <= i + 1; l += 2) {
        fill(PLANT_BLOCK, block);
        for (int e = 0; e < PLANT_BLOCK; e++)
            block[e] *= coupling;
        if (l >= 0 && l < PLANT_PARTS)
            set_block(plant, i, l, block);
    }
    plant->C[i][0] = 1;
    plant->R[i][0] = DSE_REAL(0.5);
    const dse_real Q[PLANT_BLOCK] = {DSE_REAL(0.6), DSE_REAL(0.1), DSE_REAL(0.1), DSE_REAL(0.4)};
    memcpy(plant->Q[i], Q, sizeof Q);
    fill(PLANT_NX, plant->x0 + i * PLANT_NX);
    plant->subsystems[i] = (struct dse_mhe_subsystem){.nx = PLANT_NX,
                                                      .ny = 1,
                                                      .A = plant->A_ii[i],
                                                      .C = plant->C[i],
                                                      .Q = plant->Q[i],
                                                      .R = plant->R[i],
                                                      .D = plant->D[i],
                                                      .x0 = plant->x0 + i * PLANT_NX};
}

void coordination_plant_make(struct coordination_plant *plant, dse_real coupling)
{
    memset(plant, 0, sizeof *plant);
    for (int i = 0; i < PLANT_PARTS; i++)
        make_subsystem(plant, i, coupling);
    coordination_plant_penalise(plant, 1);
    dse_real x[PLANT_N], next[PLANT_N];
    for (int i = 0; i < PLANT_N; i++)
        x[i] = 2 * plant->x0[i];
    for (int k = 0; k < PLANT_SAMPLES; k++) {
        memcpy(plant->x[k], x, sizeof x);
        for (int i = 0; i < PLANT_PARTS; i++)
            plant->y[k][i] = x[i * PLANT_NX] + DSE_REAL(0.7) * normal();
        dse_mat_vec(PLANT_N, PLANT_N, plant->A, x, next);
        for (int i = 0; i < PLANT_N; i++)
            x[i] = next[i] + DSE_REAL(0.7) * normal();
    }
}

void coordination_plant_penalise(struct coordination_plant *plant, dse_real d)
{
    for (int i = 0; i < PLANT_PARTS; i++)
        for (int e = 0; e < PLANT_BLOCK; e++)
            plant->D[i][e] = e % (PLANT_NX + 1) == 0 ? d : 0;
}

void coordination_plant_network(const struct coordination_plant *plant, enum dse_mhe_scheme scheme,
                                dse_real eps, struct coordination *net)
{
    memset(net, 0, sizeof *net);
    net->settings =
        (struct dse_mhe_settings){.scheme = scheme, .horizon = PLANT_H, .min_horizon = 2};
    net->config = (struct dse_mhe_coordinator_config){.parts = PLANT_PARTS,
                                                      .subsystems = plant->subsystems,
                                                      .A = plant->A,
                                                      .eps = eps,
                                                      .max_iter = 400};
}

/* ---- dense windows ---- */

static int state_at(int H, int i, int t, int a)
{
    return i * H * PLANT_NX + t * PLANT_NX + a;
}

static void fill_transitions(const struct coordination_plant *plant, struct coordination_window *w)
{
    const int H = w->H, columns = w->states, m = w->transitions;
    dse_real Qi[PLANT_BLOCK], L[PLANT_BLOCK];
    for (int i = 0; i < PLANT_PARTS; i++) {
        (void)dse_cholesky(PLANT_NX, plant->Q[i], L);
        dse_mat_identity(PLANT_NX, Qi);
        dse_cholesky_solve(PLANT_NX, L, PLANT_NX, Qi);
        for (int t = 0; t < H - 1; t++) {
            for (int a = 0; a < PLANT_NX; a++) {
                const int row = state_at(H - 1, i, t, a);
                w->Gb[row * columns + state_at(H, i, t + 1, a)] = 1;
                for (int l = 0; l < PLANT_PARTS; l++) {
                    for (int b = 0; b < PLANT_NX; b++) {
                        const dse_real value =
                            -plant->A[(i * PLANT_NX + a) * PLANT_N + l * PLANT_NX + b];
                        (l == i ? w->Gb : w->Th)[row * columns + state_at(H, l, t, b)] = value;
                    }
                }
                for (int b = 0; b < PLANT_NX; b++)
                    w->Qi[row * m + state_at(H - 1, i, t, b)] = Qi[a * PLANT_NX + b];
                w->Di[row * m + row] = 1 / plant->D[i][a * PLANT_NX + a];
            }
        }
    }
    for (int e = 0; e < m * columns; e++)
        w->GA[e] = w->Gb[e] + w->Th[e];
}

/* M += B'S B. */
static void add_squares(int rows, int columns, const dse_real *B, const dse_real *S, dse_real *M)
{
    for (int p = 0; p < rows; p++)
        for (int q = 0; q < rows; q++)
            for (int i = 0; i < columns && S[p * rows + q] != 0; i++)
                dse_axpy(columns, S[p * rows + q] * B[p * columns + i], B + q * columns,
                         M + i * columns);
}

void coordination_window_make(const struct coordination_plant *plant, int H, long k,
                              struct coordination_window *w)
{
    memset(w, 0, sizeof *w);
    w->H = H;
    w->states = H * PLANT_N;
    w->transitions = (H - 1) * PLANT_N;
    fill_transitions(plant, w);
    for (int i = 0; i < PLANT_PARTS; i++) {
        for (int t = 0; t < H; t++) {
            for (int a = 0; a < PLANT_NX; a++) {
                const int at = state_at(H, i, t, a);
                w->c[at] = plant->C[i][a] / plant->R[i][0] * plant->y[k - H + 1 + t][i];
                for (int b = 0; b < PLANT_NX; b++)
                    w->MC[at * w->states + state_at(H, i, t, b)] =
                        plant->C[i][a] * plant->C[i][b] / plant->R[i][0];
            }
        }
    }
    memcpy(w->Psi, w->MC, sizeof w->MC);
    add_squares(w->transitions, w->states, w->GA, w->Qi, w->Psi);
}

void coordination_window_solve(const struct coordination_window *w, bool with_D, dse_real *X)
{
    static dse_real M[PLANT_X * PLANT_X];
    memcpy(M, w->Psi, sizeof M);
    if (with_D)
        add_squares(w->transitions, w->states, w->Th, w->Di, M);
    (void)dse_cholesky(w->states, M, M);
    memcpy(X, w->c, (size_t)w->states * sizeof *X);
    dse_cholesky_solve(w->states, M, 1, X);
}

void coordination_stack(const struct coordination *net, dse_real *X)
{
    for (int i = 0; i < PLANT_PARTS; i++) {
        const int size = dse_mhe_local_length(&net->local[i]) * PLANT_NX;
        memcpy(X, dse_mhe_local_window(&net->local[i]), (size_t)size * sizeof *X);
        X += size;
    }
}
