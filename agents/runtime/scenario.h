/* One experiment as its YAML file states it: plant, noise, networks of estimators.
 *
 * Read by libcyaml against the schema of scenario_schema.c; the section of a network's method has
 * the schema that the method brings (agents/methods). Every error names file, line, key and value
 * and says what is allowed:
 *
 *     x.yaml:12: networks[0].high_gain_ekf.theta_m: -3 is out of range; it must be > 1 (..)
 *
 * Anchors, aliases and merge keys (<<) work: a network can repeat another one's section and change
 * one key of it. Unless a comment says otherwise, a key that may be left out is 0 or NULL then. */
#ifndef DSE_RUNTIME_SCENARIO_H
#define DSE_RUNTIME_SCENARIO_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include <cyaml/cyaml.h>

#include "dse/link.h"
#include "dse/plant.h"
#include "runtime/error.h"

#define SCENARIO_MAX_METHODS  32 /* registered methods, see agents/methods/registry.c */
#define SCENARIO_MAX_NETWORKS 16
#define SCENARIO_MAX_SAMPLES  1e9
#define SCENARIO_MAX_DELAY    100 /* networks[].link.D, in communication periods */

struct scenario_time {
    double period_s;   /* sampling period in seconds, > 0 */
    double duration_s; /* length of the run in seconds, >= period_s */
};

struct scenario_parameter {
    char *name;
    double value;
};

enum scenario_integrator_kind { SCENARIO_CVODE, SCENARIO_RK4, SCENARIO_FLOW };

struct scenario_integrator {
    enum scenario_integrator_kind kind; /* default cvode */
    double rtol;                        /* 0: 1e-10 */
    double atol;                        /* 0: 1e-12 */
};

enum scenario_signal { SCENARIO_CONSTANT, SCENARIO_STEPS, SCENARIO_SINUSOID, SCENARIO_PRBS };

struct scenario_step {
    double at_s;  /* seconds, >= 0, ascending; acts from the first sample not before it */
    double value; /* from there on */
};

struct scenario_pid {
    double kp;   /* output unit per unit of the measurement */
    double ti_s; /* integral time in seconds, 0: no integral action */
    double td_s; /* derivative time in seconds */
};

struct scenario_loop {
    char *output;               /* the plant's output that the loop controls */
    struct scenario_pid outer;  /* measurement in, input (or its set point) out */
    struct scenario_pid *inner; /* cascade: input in, command of the actuator out; NULL: none */
    double low, high;           /* limits of the input */
    double lag_s;               /* time constant of the actuator, cascade only */
};

/* What one input does: the signal itself, or a loop with the signal as set point. */
struct scenario_drive {
    char *name; /* an input of the plant */
    enum scenario_signal signal;
    double value;     /* constant, before the first step, or mean */
    double amplitude; /* sinusoid, prbs */
    double omega;     /* sinusoid, rad/s */
    double phase;     /* sinusoid, rad */
    double bit_s;     /* prbs, seconds per bit */
    struct scenario_step *steps;
    unsigned steps_count;
    struct scenario_loop *loop; /* NULL: the signal is the input */
};

enum scenario_time_kind { SCENARIO_CONTINUOUS, SCENARIO_DISCRETE };

/* x' = A(t) (x - o) + B u or x(k+1) = o + A(t) (x - o) + B u, y = C x: a plant without code, around
 * its operating point o, with A(t) = A + A_sin sin(omega t). Matrices row by row. */
struct scenario_linear {
    enum scenario_time_kind time; /* default continuous; discrete: one step per sample */
    double unit_s;                /* seconds in one unit of plant time, 0: 1 */
    unsigned nx, nu;
    unsigned unknown; /* so many inputs, the last ones, are not told to estimators */
    double *A;        /* nx x nx */
    unsigned A_count;
    double *B; /* nx x nu, NULL when nu = 0 */
    unsigned B_count;
    double *C; /* ny x nx; ny follows from it */
    unsigned C_count;
    double *A_sin; /* nx x nx, NULL: A is constant */
    unsigned A_sin_count;
    double omega;   /* rad/s */
    double *origin; /* o, nx, NULL: 0 */
    unsigned origin_count;
    char **states; /* names, NULL: x1, x2, .. */
    unsigned states_count;
    unsigned *groups; /* rows of C that each sensor group has, in order; NULL: one group */
    unsigned groups_count;
    unsigned *blocks; /* states that belong to each group, in order; NULL: none do */
    unsigned blocks_count;
};

struct scenario_linear_plant;

struct scenario_plant {
    char *name;
    struct scenario_linear *linear; /* with the plant called linear, else NULL */
    char *set;                      /* parameter set, NULL: the plant's first */
    struct scenario_parameter *parameters;
    unsigned parameters_count;
    double *x0; /* true initial state, NULL: that of the set */
    unsigned x0_count;
    double *inputs; /* constant known inputs, NULL: nominal */
    unsigned inputs_count;
    struct scenario_drive *drive; /* inputs that vary */
    unsigned drive_count;
    struct scenario_integrator integrator;
};

enum scenario_distribution { SCENARIO_NONE, SCENARIO_UNIFORM, SCENARIO_GAUSSIAN };

/* Noise per channel, drawn anew at every sample and held over it. scale: the bound of a uniform
 * distribution on [-scale, scale], the standard deviation of a Gaussian one, which is clipped to
 * [-limit, limit] where limits are given. */
struct scenario_noise {
    enum scenario_distribution distribution;
    double *scale; /* one per state (process, units per plant time unit if continuous) or output
                      (measurement) */
    unsigned scale_count;
    double *limit; /* as many, NULL: none */
    unsigned limit_count;
};

/* No value of an output comes in [start_s, end_s): a sensor that is out. */
struct scenario_dead_sensor {
    char *output;
    double start_s; /* seconds of plant time */
    double end_s;   /* 0: never ends */
};

struct scenario_noises {
    struct scenario_noise process;
    struct scenario_noise measurement;
    double missing; /* probability that an output's value does not come, per sample, [0, 1] */
    struct scenario_dead_sensor *dead;
    unsigned dead_count;
};

/* Who hears whom, for methods whose nodes do not all hear each other. */
struct scenario_graph {
    unsigned nodes;  /* 1 .. */
    unsigned *edges; /* from, to, from, to, ..: node indices from 0; `to` hears `from` */
    unsigned edges_count;
    bool undirected; /* each edge also the other way */
};

/* Nothing that was sent in [start_s, end_s) arrives. */
struct scenario_outage {
    int from, to;   /* nodes, -1: any */
    double start_s; /* seconds of plant time */
    double end_s;   /* 0: never ends */
};

/* What the network does to the messages of the estimators, put in at the receivers. */
struct scenario_link {
    unsigned D;    /* largest delay, in communication periods of the method */
    unsigned T_m;  /* most consecutive losses of one sender and receiver */
    double loss;   /* probability, where T_m allows a loss */
    uint64_t seed; /* added to the scenario's */
    char *file;    /* recorded network, a CSV beside the scenario; NULL: random */
    struct scenario_outage *outages;
    unsigned outages_count;
};

struct method_graph; /* methods/method.h */
struct scenario_fates;

/* One set of estimators that talk to each other. Several networks in a scenario estimate from the
 * same measurements: that is how methods are compared fairly.
 *
 * The estimators know the plant as it is (plant.set with plant.parameters) unless the network says
 * otherwise: a set of its own replaces both, then its own parameters are put in. */
struct scenario_network {
    char *name;
    char *title; /* for legends and tables, NULL: the method's */
    struct scenario_parameter
        *parameters; /* the estimators' own plant parameters: model mismatch */
    unsigned parameters_count;
    char *set;     /* the estimators' own parameter set, NULL: the plant's */
    double *guess; /* the estimators' initial guess of the whole physical state */
    unsigned guess_count;
    struct scenario_graph *graph;        /* NULL: the method's own */
    struct scenario_link *link;          /* NULL: nothing is late or lost */
    void *section[SCENARIO_MAX_METHODS]; /* exactly one is not NULL: that of the network's method */

    /* Filled by the reader, not by YAML: */
    struct method_graph *neighbours; /* of the graph; NULL: none given */
    struct scenario_fates *fates;    /* of the link; NULL: none given */
};

/* A file that the scenario names, as it was read. */
struct scenario_part {
    char *name; /* as the scenario says it */
    char *text;
};

struct scenario_timeouts {
    double repeat_s;   /* a missing message is asked for again after this, 0: 0.05 */
    double give_up_s;  /* nobody waits longer than this for anything, 0: 20 */
    double patience_s; /* .. nor longer than this for a node that it can do without, 0: 5 */
};

struct scenario {
    char *name;
    char *title;
    char *source; /* where the experiment comes from */
    uint64_t seed;
    struct scenario_time time;
    struct scenario_plant plant;
    struct scenario_noises noise;
    struct scenario_network *networks;
    unsigned networks_count;
    struct scenario_timeouts timeouts;

    /* Filled by the reader, not by YAML: */
    const struct dse_plant *process; /* the plant called plant.name, or the one of plant.linear */
    struct scenario_linear_plant *linear; /* what holds the latter, NULL: none */
    char *file;                           /* as given, for messages */
    char *yaml;                           /* the text as read */
    char **overrides;                     /* "key=value" as given with --set */
    unsigned overrides_count;
    struct scenario_part *parts; /* files that it names: recorded networks */
    unsigned parts_count;
    uint64_t hash; /* of the values, overrides and the numbers in named files included: equal hash,
                    * equal experiment. What cannot change a result does not count: comments,
                    * layout, title, source, timeouts */
};

/* How many entries a list of numbers has. */
enum scenario_count {
    SCENARIO_COUNT_ANY,
    SCENARIO_PER_STATE,
    SCENARIO_PER_INPUT,
    SCENARIO_PER_OUTPUT,
    SCENARIO_PER_SUBSYSTEM
};

/* What a key means and which numbers it takes. The key is relative to the section that owns the
 * table, lists are marked: "theta_m", "time.period_s", "networks[].name". The limits of a list of
 * numbers hold for each entry. Every key of a schema has one: checks, messages and the printed
 * table of keys draw on it. Numbers that are stated are checked, also where 0 means the default. */
struct scenario_rule {
    const char *key;
    double min, max; /* +-INFINITY: no limit; written with SCENARIO_ABOVE .. below */
    bool min_open;   /* the value must be greater than min, not equal */
    enum scenario_count count;
    const char *absent;  /* what holds when the key is left out; NULL: required, or just nothing */
    const char *meaning; /* one line, with the unit: for --keys and messages */
};

#define SCENARIO_ABOVE(limit)    .min = (limit), .max = INFINITY, .min_open = true
#define SCENARIO_AT_LEAST(limit) .min = (limit), .max = INFINITY, .min_open = false
#define SCENARIO_ANY             .min = -INFINITY, .max = INFINITY, .min_open = false

/* Reads `path` with the overrides applied. NULL and an error text on any failure.
 *
 * An override is "key=value" with the key as in error messages, list entries by index or by their
 * name, and the value in YAML: "seed=7", "networks.ahg.high_gain_ekf.theta_m=8",
 * "networks[0].guess=[360, 3, 320, 2.5]", "plant.parameters.F_r=36". It works whether or not the
 * file has the key. */
struct scenario *scenario_read(const char *path, const char *const *overrides,
                               unsigned overrides_count, struct error *error);
/* Same from memory; `file` is the name used in messages, and the place beside which named files
 * lie. */
struct scenario *scenario_parse(const char *yaml, const char *file, const char *const *overrides,
                                unsigned overrides_count, struct error *error);
/* Same with the texts of named files, as a log has them: only a file that is not among them is
 * looked for beside `file`. */
struct scenario *scenario_parse_recorded(const char *yaml, const char *file,
                                         const struct scenario_part *parts, unsigned parts_count,
                                         const char *const *overrides, unsigned overrides_count,
                                         struct error *error);
void scenario_free(struct scenario *scenario);

/* `name` itself when it is a readable file, else the only *.yaml file among the scenario folders
 * whose name begins with it; a whole word wins ("ahg-4" is ahg-4_x.yaml rather than ahg-43_y.yaml).
 * The folders: those in $DSE_SCENARIOS (separated by colons), then the one given at build time; an
 * earlier folder hides files of the same name in a later one. False and an error that lists what
 * there is, or all matches when there are several. */
bool scenario_find(const char *name, char *path, unsigned path_size, struct error *error);

/* Number of samples, duration_s / period_s rounded: k = 0 .. samples-1. */
int64_t scenario_samples(const struct scenario *scenario);
/* The first sample that is not before `seconds`; 1e-9 of a period forgives decimals such as 0.1. */
int64_t scenario_sample_at(const struct scenario *scenario, double seconds);
/* Sampling period in the plant's time unit: period_s / time_unit_s. */
double scenario_period(const struct scenario *scenario);
/* timeouts.patience_s or its default. */
double scenario_patience_s(const struct scenario *scenario);

/* The plant's parameter values for the simulator (network NULL) or for a network's estimators, and
 * what dse_plant.prepare makes of them. prepared: process->prepared_size reals. */
bool scenario_prepare_plant(const struct scenario *scenario, const struct scenario_network *network,
                            dse_real *values, dse_real *prepared, struct error *error);
/* What the network's link does to packets, for all pairs of its nodes, with outages counted in
 * samples; NULL: it has none. A method puts it to use by methods/lossy_link.h. */
const struct dse_link_config *scenario_link_fates(const struct scenario_network *network);
/* Index of the network's method in the registry. */
int scenario_method(const struct scenario_network *network);

/* Prints the table of all keys: type, default, limits, meaning (dse-run --keys). */
void scenario_print_keys(void);
/* Prints name and title of every scenario in the folders (dse-run --list). */
void scenario_print_list(void);

#endif
