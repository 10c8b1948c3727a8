/* Some subsystems of a plant as a plant of their own: those upstream of one another in a series,
 * for example, which nothing downstream acts upon. What is chosen has to be closed,
 *
 *     d chi_i'/d chi_j = 0    for every chosen i and every j that is not,
 *
 * then the chosen states move as in the whole plant, bit for bit, and a filter or predictor that
 * needs no other ones carries a smaller state and listens to fewer neighbours (Remark 4 of the
 * adaptive high-gain source).
 *
 * The functions of the part write its states into a copy of the whole state, in which the others
 * stand still, and call those of the whole: they save memory and messages, not evaluations. A part
 * of a part is chosen from the whole at once. */
#ifndef DSE_PART_H
#define DSE_PART_H

#include "dse/arena.h"
#include "dse/model.h"
#include "dse/normal_form.h"
#include "dse/real.h"
#include "dse/status.h"

#define DSE_PART_LANES 8 /* states that f_many hands to the whole at a time */

struct dse_part {
    struct dse_model model;      /* of the part: what a filter takes */
    struct dse_normal_form form; /* of the part */

    const struct dse_model *whole;
    const struct dse_normal_form *whole_form;
    int blocks;
    const int *block;       /* blocks: the chosen subsystems, ascending */
    int *state, *output;    /* where the part's states and outputs lie in the whole */
    int *n_i, *n_outputs;   /* blocks */
    int *chains;            /* one per output */
    dse_real *x, *z;        /* whole state and coordinates; what is not chosen stays */
    dse_real *dx;           /* of the whole */
    dse_real *many, *dmany; /* DSE_PART_LANES whole states, and their derivatives */
    dse_real *y;            /* outputs of the whole */
    dse_real *F;            /* nx x nx or ny x nx of the whole */
};

/* Reals for a part of a plant with nx states, ny outputs and p subsystems. */
#define DSE_PART_STORAGE(nx, ny, p)                                                                \
    ((3 + 2 * DSE_PART_LANES) * (nx) + (ny) + (nx) * ((nx) > (ny) ? (nx) : (ny)) +                 \
     DSE_ARENA_INTS(nx) + 2 * DSE_ARENA_INTS(ny) + 2 * DSE_ARENA_INTS(p))

/* The subsystems block[0] < block[1] < .. of the form; the model has one output for each chain.
 * x (nx): a whole physical state at which everything can be evaluated, with inputs u; there the
 * states that are not chosen stay. Whole, form and block must outlive the part. DSE_EINVAL: no such
 * blocks; DSE_EDIM, DSE_ESTORAGE, or what the form answers. */
enum dse_status dse_part_init(struct dse_part *part, const struct dse_model *whole,
                              const struct dse_normal_form *form, const int *block, int blocks,
                              const dse_real *x, const dse_real *u, struct dse_arena *arena);

/* Whether the choice is closed, by the model's Jacobian at the state given above: DSE_OK, or
 * DSE_EINVAL with the subsystem *by outside that acts on *on inside. Needs dfdx. */
enum dse_status dse_part_closed(const struct dse_part *part, dse_real t, const dse_real *u, int *by,
                                int *on);

#endif
