/* The section `coordinated_mhe` of a network: coordinated moving horizon estimation and the
 * estimators that it is compared with, under the names of its source. */
#ifndef DSE_METHODS_COORDINATED_MHE_SECTION_H
#define DSE_METHODS_COORDINATED_MHE_SECTION_H

#include "dse/coordinated_mhe.h"
#include "runtime/error.h"
#include "runtime/scenario.h"

enum coordinated_mhe_scheme {
    COORDINATED_MHE_PREDICTION,
    COORDINATED_MHE_PRICE,
    COORDINATED_MHE_DECENTRALISED,
    COORDINATED_MHE_CENTRALISED
};

enum coordinated_mhe_warm_start { COORDINATED_MHE_HOLD = 0, COORDINATED_MHE_SHIFT = 1 };

/* Diagonals run over the plant's states (outputs) in the plant's order. NULL: not given. */
struct coordinated_mhe_section {
    enum coordinated_mhe_scheme scheme;
    unsigned Hp, Hmin;
    double *Q, *R, *D, *P_inv; /* n, ny, n, n */
    unsigned Q_count, R_count, D_count, P_inv_count;
    double *x_min, *x_max; /* n, physical units */
    unsigned x_min_count, x_max_count;
    double *w_min, *w_max; /* n */
    unsigned w_min_count, w_max_count;
    double t;       /* 1 / weight of the log barrier; 0: hard bounds */
    double *origin; /* n, physical units: where the plant is linearised */
    unsigned origin_count;

    double eps;        /* 0: 1e-3 */
    unsigned max_iter; /* 0: 100 */
    bool fixed_iter;   /* exactly max_iter rounds */
    bool stop_on_any;  /* the source's stopping test */
    unsigned max_age;  /* 0: Hp */
    enum dse_mhe_price_start price_start;
    double kappa;
    unsigned recentrings;
    enum coordinated_mhe_warm_start warm_start;
    double rho_consistent;
    double beta;
    unsigned anderson;
    double *x_weight, *p_weight; /* n */
    unsigned x_weight_count, p_weight_count;
    double *eps_i; /* one per subsystem */
    unsigned eps_i_count;
};

extern const cyaml_schema_field_t coordinated_mhe_fields[];
extern const struct scenario_rule coordinated_mhe_rules[];

/* Whether the network's last node is a coordinator. */
bool coordinated_mhe_is_coordinated(const struct coordinated_mhe_section *section);

/* Combinations that no limit on a single number covers. */
bool coordinated_mhe_section_check(const struct coordinated_mhe_section *section,
                                   struct error *error);

#endif
