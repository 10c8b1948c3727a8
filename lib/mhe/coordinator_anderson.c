/* Coordinator of moving horizon estimators: Anderson acceleration of the prediction-driven
 * iteration z -> f(z), z = (X, p).
 *
 * Of the last answers f_0 (newest) .. f_m to the questions z_j, with r_j = f_j - z_j, the next
 * question is
 *
 *     z = f_0 - sum_j gamma_j (f_j - f_{j+1}),   gamma minimises |r_0 - sum_j gamma_j (r_j -
 * r_{j+1})|
 *
 * in the weights of the configuration (D. G. Anderson, J. ACM 12, 1965). */
#include "coordinator_internal.h"
#include "dse/linalg.h"

static void push(struct dse_mhe_coordinator *c, int size)
{
    struct dse_mhe_anderson *a = &c->anderson;
    const int states = c->length * c->n;
    for (int e = a->memory * size - 1; e >= 0; e--) {
        a->f[e + size] = a->f[e];
        a->r[e + size] = a->r[e];
    }
    for (int e = 0; e < size; e++) {
        const bool state = e < states;
        a->f[e] = state ? c->X[e] : c->other[e - states];
        a->r[e] = a->f[e] - (state ? c->asked[e] : c->p[e - states]);
    }
    a->count += a->count <= a->memory;
}

/* QR (size x columns) and b, weighted: the weight of an entry is that of its state. */
static void fill(struct dse_mhe_coordinator *c, int size, int columns)
{
    struct dse_mhe_anderson *a = &c->anderson;
    int e = 0;
    for (int part = 0; part < 2; part++) {
        const dse_real *weights = part == 0 ? c->config->x_weight : c->config->p_weight;
        const int times = c->length - part;
        for (int i = 0; i < c->parts; i++) {
            const int nx = coordinator_nx(c, i);
            for (int q = 0; q < times * nx; q++, e++) {
                const dse_real weight = weights ? weights[c->first[i] + q % nx] : 1;
                a->b[e] = weight * a->r[e];
                for (int j = 0; j < columns; j++)
                    a->QR[e * columns + j] =
                        weight * (a->r[j * size + e] - a->r[(j + 1) * size + e]);
            }
        }
    }
}

/* The least squares with as many differences as are independent. */
static int solve(struct dse_mhe_coordinator *c, int size)
{
    struct dse_mhe_anderson *a = &c->anderson;
    int columns = a->count - 1;
    for (; columns > 0; columns--) {
        fill(c, size, columns);
        if (dse_qr(size, columns, a->QR, a->tau) != DSE_OK)
            continue;
        dse_qr_solve(size, columns, a->QR, a->tau, a->b, a->gamma);
        break;
    }
    a->count = columns + 1;
    return columns;
}

void coordinator_accelerate(struct dse_mhe_coordinator *c)
{
    struct dse_mhe_anderson *a = &c->anderson;
    const int states = c->length * c->n, size = states + (c->length - 1) * c->n;
    push(c, size);
    const int columns = solve(c, size);
    for (int e = 0; e < size; e++) {
        dse_real z = a->f[e];
        for (int j = 0; j < columns; j++)
            z -= a->gamma[j] * (a->f[j * size + e] - a->f[(j + 1) * size + e]);
        if (e < states)
            c->asked[e] = z;
        else
            c->p[e - states] = z;
    }
}
