/* A continuous linear plant without inputs as a discrete model, for filters of discrete form:
 *
 *     A(k) = expm(T A(t_k + T/2)),   Q_d = T Q,   R_d = R / T */
#ifndef DSE_METHODS_DISCRETISED_H
#define DSE_METHODS_DISCRETISED_H

#include "dse/linalg.h"
#include "dse/model.h"

#define DISCRETISED_SCRATCH(nx) ((nx) * (nx) + DSE_EXPM_SCRATCH(nx))

struct discretised {
    const struct dse_model *plant; /* continuous, dfdx = A(t) */
    dse_real period;
    dse_real *scratch; /* DISCRETISED_SCRATCH(nx) */
};

/* Fills `model`, which keeps a pointer to `made`: no f, for A(k) says all. */
void discretised_model(struct dse_model *model, const struct discretised *made);

#endif
