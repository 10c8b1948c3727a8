"""decode, field and jacobian in C where the inverse of the coordinates needs an iteration.

decode takes the steps of the inverse in order, Newton's method for those without a closed form. The
Jacobian follows from the implicit function theorem: dchi/dz = (dPhi/dchi)^-1, so that

    F = A + db/dz + (db/dchi) (dPhi/dchi)^-1
"""

import casadi as ca

from dse.design.c_function import Builder, CFunction, finite, form_function, unused
from dse.design.invert import Step
from dse.design.lie import SX, NormalForm

ITERATIONS = 50
HALVINGS = 30

SOLVER = """\
struct equations {
    int m;             /* how many */
    const int *rows;   /* coordinates that they are about */
    const int *states; /* their unknowns */
    enum dse_status (*phi)(const dse_real *q, dse_real t, const dse_real *chi, const dse_real *u,
                           dse_real *phi);
    void (*slope)(const dse_real *q, dse_real t, const dse_real *chi, const dse_real *u,
                  dse_real *J);
};

/* r = Phi(chi) - z in the equations' rows. */
static enum dse_status mismatch(const struct equations *eq, const dse_real *q, dse_real t,
                                const dse_real *z, const dse_real *u, const dse_real *chi,
                                dse_real *r)
{
    if (eq->phi(q, t, chi, u, r) != DSE_OK) {
        return DSE_EMODEL;
    }
    for (int k = 0; k < eq->m; k++) {
        r[k] -= z[eq->rows[k]];
    }
    return dse_all_finite(r, eq->m) ? DSE_OK : DSE_EMODEL;
}

/* sum_k (r_k / w_k)^2 */
static dse_real merit(int m, const dse_real *r, const dse_real *w)
{
    dse_real sum = 0;
    for (int k = 0; k < m; k++) {
        sum += r[k] / w[k] * (r[k] / w[k]);
    }
    return sum;
}

/* chi_new = chi - cut (J^-1 r), cut halved until the mismatch falls; 0 when it never does. */
static dse_real advance(const struct equations *eq, const dse_real *q, dse_real t,
                        const dse_real *z, const dse_real *u, const dse_real *step,
                        const dse_real *w, dse_real *chi, dse_real *r)
{
    dse_real from[LARGEST];
    const dse_real before = merit(eq->m, r, w);
    dse_real cut = 1;
    for (int k = 0; k < eq->m; k++) {
        from[k] = chi[eq->states[k]];
    }
    for (int n = 0; n < HALVINGS; n++, cut /= 2) {
        for (int k = 0; k < eq->m; k++) {
            chi[eq->states[k]] = from[k] - cut * step[k];
        }
        if (mismatch(eq, q, t, z, u, chi, r) == DSE_OK &&
            merit(eq->m, r, w) <= dse_max(before, DSE_REAL_EPSILON)) {
            return cut;
        }
    }
    return 0;
}

/* Solves the equations for their unknowns in chi by Newton's method from the nominal states.
 * Converged: the last step, a whole one, was below sqrt(eps) of the states' sizes, and what is left
 * of the mismatch is below sqrt(eps) of what such sizes make. */
static enum dse_status newton(const struct equations *eq, const dse_real *q, dse_real t,
                              const dse_real *z, const dse_real *u, dse_real *chi)
{
    const dse_real tolerance = dse_sqrt(DSE_REAL_EPSILON);
    dse_real r[LARGEST], step[LARGEST], w[LARGEST], J[LARGEST * LARGEST];
    int pivots[LARGEST];
    const int m = eq->m;
    for (int k = 0; k < m; k++) {
        chi[eq->states[k]] = states[eq->states[k]].nominal;
    }
    if (mismatch(eq, q, t, z, u, chi, r) != DSE_OK) {
        return DSE_EMODEL;
    }
    for (int n = 0; n < ITERATIONS; n++) {
        dse_real size = 0;
        eq->slope(q, t, chi, u, J);
        for (int k = 0; k < m; k++) {
            step[k] = r[k];
            w[k] = DSE_REAL_MIN;
            for (int l = 0; l < m; l++) {
                w[k] += dse_abs(J[k * m + l]) *
                        (dse_abs(chi[eq->states[l]]) + states[eq->states[l]].scale);
            }
        }
        if (!dse_all_finite(J, m * m) || dse_lu(m, J, pivots) != DSE_OK) {
            return DSE_EMODEL;
        }
        dse_lu_solve(m, J, pivots, 1, step);
        for (int k = 0; k < m; k++) {
            const struct dse_signal *state = &states[eq->states[k]];
            size = dse_max(size, dse_abs(step[k]) / (dse_abs(chi[eq->states[k]]) + state->scale));
        }
        const dse_real cut = advance(eq, q, t, z, u, step, w, chi, r);
        if (!(cut > 0)) {
            return DSE_EMODEL;
        }
        if (cut >= 1 && size <= tolerance) {
            return merit(m, r, w) <= tolerance * tolerance ? DSE_OK : DSE_EMODEL;
        }
    }
    return DSE_EMODEL;
}
"""

STACK = """\
/* A Jacobian takes 2 STATES^2 reals of the stack. Where it has more room than that of a small
 * microcontroller: -DDSE_PLANT_STACK=8192. */
#ifndef DSE_PLANT_STACK
#define DSE_PLANT_STACK 2048
#endif
_Static_assert(2 * STATES * STATES * sizeof(dse_real) <= DSE_PLANT_STACK,
               "too many states for the stack: see DSE_PLANT_STACK");
"""

BLOCK = """\
/* F (count x count) = the diagonal block of A + db/dz + (db/dchi) (dPhi/dchi)^-1 that begins at
 * `first`: column c is what a change of z_c does, alone and by way of chi. */
static enum dse_status block_of_slope(const dse_real *q, dse_real t, const dse_real *z,
                                      const dse_real *u, int first, int count, dse_real *F)
{
    dse_real chi[STATES], D[STATES * STATES], B[STATES * STATES], x[STATES];
    int pivots[STATES];
    const enum dse_status status = invert(q, t, z, u, chi);
    if (status != DSE_OK) {
        return status;
    }
    map_slope(q, t, z, chi, u, D);
    if (!dse_all_finite(D, STATES * STATES) || dse_lu(STATES, D, pivots) != DSE_OK) {
        return DSE_EMODEL;
    }
    rest_by_chi(q, t, z, chi, u, B);
    for (int c = 0; c < count; c++) {
        for (int k = 0; k < STATES; k++) {
            x[k] = k == first + c ? 1 : 0;
        }
        dse_lu_solve(STATES, D, pivots, 1, x);
        for (int r = 0; r < count; r++) {
            dse_real sum = 0;
            for (int k = 0; k < STATES; k++) {
                sum += B[(first + r) * STATES + k] * x[k];
            }
            F[r * count + c] = sum;
        }
    }
    rest_by_z(q, t, z, chi, u, B);
    for (int r = 0; r < count; r++) {
        for (int c = 0; c < count; c++) {
            F[r * count + c] += B[(first + r) * STATES + first + c];
        }
    }
    return dse_all_finite(F, count * count) ? DSE_OK : DSE_EMODEL;
}
"""

HELPER = "const dse_real *q, dse_real t,\n    const dse_real *chi, const dse_real *u, dse_real *"


def functions(form: NormalForm, build: Builder) -> list[CFunction]:
    """The functions, helpers first."""
    largest = max(len(step.rows) for step in form.steps if step.solution is None)
    bounds = f"enum {{ LARGEST = {largest}, ITERATIONS = {ITERATIONS}, HALVINGS = {HALVINGS} }};"
    made = [CFunction("", [], raw=f"{bounds}\n\n{STACK}\n{SOLVER.rstrip()}")]
    for k, step in enumerate(form.steps):
        if step.solution is None:
            made += _equations(form, build, k, step)
    return [
        *made,
        _inverse(form, build),
        _decode(build),
        _field(form, build),
        *_jacobian(form, build),
    ]


def _equations(form: NormalForm, build: Builder, k: int, step: Step) -> list[CFunction]:
    """phi_k, slope_k and the table equations_k of one step."""
    s, states = form.symbols, form.symbols.x[step.unknowns]
    later = [n for other in form.steps[k + 1 :] for n in other.unknowns]
    ready = [d for d in form.domain if not later or not ca.depends_on(d, s.x[later])]
    phi = build.body([("phi", form.phi[step.rows])], state="chi", conditions=ready)
    slope = build.body([("J", ca.jacobian(form.phi[step.rows], states))], state="chi")
    names = ("q", "t", "chi", "u")
    what = ", ".join(form.plant.states[n].name for n in step.unknowns)
    table = "\n".join(
        [
            f"static const int rows_{k}[] = {{{', '.join(map(str, step.rows))}}};",
            f"static const int unknowns_{k}[] = {{{', '.join(map(str, step.unknowns))}}};",
            f"static const struct equations equations_{k} = {{",
            f"    {len(step.rows)}, rows_{k}, unknowns_{k}, phi_{k}, slope_{k}}};",
        ]
    )
    return [
        CFunction(
            f"static enum dse_status phi_{k}({HELPER}phi)",
            [*unused(phi, names), *phi, "return DSE_OK;"],
            [f"/* The equations for {what}. */"],
        ),
        CFunction(f"static void slope_{k}({HELPER}J)", [*unused(slope, names), *slope]),
        CFunction("", [], raw=table),
    ]


def _inverse(form: NormalForm, build: Builder) -> CFunction:
    """The inverse chi = Phi^-1(z), step by step."""
    lines: list[str] = []
    for k, step in enumerate(form.steps):
        if step.solution is None:
            call = f"newton(&equations_{k}, q, t, z, u, chi)"
            lines += [f"if ({call} != DSE_OK) {{", "    return DSE_EMODEL;", "}"]
        else:
            body = build.body(
                [("chi", step.solution)],
                state="chi",
                conditions=step.conditions,
                indices=step.unknowns,
            )
            scope = len(body) > 1  # its constants have names of their own
            lines += ["{", *(f"    {line}" for line in body), "}"] if scope else body
    lines += build.body([], state="chi", conditions=form.domain)
    head = (
        "static enum dse_status invert(const dse_real *q, dse_real t, const dse_real *z,\n"
        "    const dse_real *u, dse_real *chi)"
    )
    lines = [*unused(lines, ("q", "t", "z", "u")), *lines, finite("chi", "STATES")]
    return CFunction(head, lines, ["/* chi = Phi^-1(z). */"])


def _decode(build: Builder) -> CFunction:
    return form_function(
        build, "decode", "z chi", ["return invert(q, t, z, u, chi);"], "chi = Phi^-1(z)"
    )


INVERT = [
    "dse_real chi[STATES];",
    "const enum dse_status status = invert(q, t, z, u, chi);",
    "if (status != DSE_OK) {",
    "    return status;",
    "}",
]


def _field(form: NormalForm, build: Builder) -> CFunction:
    e = form.shift(form.symbols.z) + form.rest
    lines = build.body([("dz", e)], state="chi", before=INVERT)
    lines.append(finite("dz", "STATES"))
    return form_function(build, "field", "z dz", lines, "z' = A z + b(z, u)")


def _jacobian(form: NormalForm, build: Builder) -> list[CFunction]:
    """field_jacobian and jacobian: a diagonal block of F, column by column."""
    s = form.symbols
    by_chi, by_z = (ca.jacobian(form.rest, v) for v in (s.x, s.z))
    return [
        _matrix(build, "map_slope", ca.jacobian(form.phi, s.x), "D = dPhi/dchi."),
        _matrix(build, "rest_by_chi", by_chi, "D = db/dchi."),
        _matrix(build, "rest_by_z", by_z + ca.jacobian(form.shift(s.z), s.z), "D = A + db/dz."),
        CFunction("", [], raw=BLOCK.rstrip()),
        form_function(
            build,
            "field_jacobian",
            "z F",
            ["return block_of_slope(q, t, z, u, 0, STATES, F);"],
            "F = A + db/dz",
        ),
        form_function(
            build,
            "jacobian",
            "z F",
            [
                "if (i < 0 || i >= BLOCKS) {",
                "    return DSE_EINVAL;",
                "}",
                "int first = 0;",
                "for (int k = 0; k < i; k++) {",
                "    first += block_sizes[k];",
                "}",
                "return block_of_slope(q, t, z, u, first, block_sizes[i], F);",
            ],
            "F = A_i + db_i/dz_i, other z_j frozen",
        ),
    ]


def _matrix(build: Builder, name: str, value: SX, meaning: str) -> CFunction:
    """A function that fills a matrix D (STATES x STATES)."""
    lines = build.body([("D", value)], state="chi")
    return CFunction(
        f"static void {name}(const dse_real *q, dse_real t, const dse_real *z,\n"
        "    const dse_real *chi, const dse_real *u, dse_real *D)",
        [*unused(lines, ("q", "t", "z", "chi", "u")), *lines],
        [f"/* {meaning} */"],
    )
