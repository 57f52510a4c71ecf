/* The stochastic midpoint rule as a program for `sepv verify --exec`, in C99 without a library.
 *
 *     cc -O2 -o midpoint examples/midpoint.c -lm
 *     sepv verify --exec ./midpoint
 *
 * y1 = y0 + D f((y0 + y1)/2), f = B grad H, with the random step D = h + sum_j c_j dW_j: equation (3.4) of
 * D. Cohen and G. Dujardin, Energy-preserving integrators for stochastic Poisson systems (2014). The rule keeps
 * quadratic Casimirs, is symmetric, and keeps a quadratic H. docs/protocol.md describes the protocol.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAXD = 16, MAXE = MAXD * (MAXD - 1) / 2, MAXM = 16, MAX_ITERATIONS = 40 };

/* ---- JSON: the text is not copied; a value is a pointer to its first character. ---- */

static const char *blank(const char *p) {
    while (*p == ' ' || *p == '\t' || *p == '\r' || *p == '\n') p++;
    return p;
}

/* The character after the value at p, or NULL if the text is not JSON or is nested more than 64 deep. */
static const char *after(const char *p, int depth) {
    if (!p || depth > 64) return NULL;
    p = blank(p);
    if (*p == '"') {
        for (p++; *p != '"'; p++) {
            if (*p == '\\') p++;
            if (!*p) return NULL;
        }
        return p + 1;
    }
    if (*p == '[' || *p == '{') {
        char close = *p == '[' ? ']' : '}';
        int object = *p == '{';
        p = blank(p + 1);
        if (*p == close) return p + 1;
        for (;;) {
            if (object) {
                if (*p != '"' || !(p = after(p, depth + 1))) return NULL;
                p = blank(p);
                if (*p++ != ':') return NULL;
            }
            if (!(p = after(p, depth + 1))) return NULL;
            p = blank(p);
            if (*p == close) return p + 1;
            if (*p++ != ',') return NULL;
            p = blank(p);
        }
    }
    size_t n = strspn(p, "+-.0123456789abcdefghijklmnopqrstuvwxyzE"); /* numbers, true, false, null */
    return n ? p + n : NULL;
}

/* The first element of the array at p, and the one after the element at p; NULL at the end. */
static const char *first(const char *p) {
    if (!p || *(p = blank(p)) != '[') return NULL;
    p = blank(p + 1);
    return *p == ']' ? NULL : p;
}

static const char *next(const char *p) {
    p = blank(after(p, 0));
    return *p == ',' ? blank(p + 1) : NULL;
}

static int is_text(const char *p, const char *text) {
    size_t n = strlen(text);
    return p && *p == '"' && !strncmp(p + 1, text, n) && p[n + 1] == '"';
}

/* The value of a member of the object at p, or NULL. */
static const char *member(const char *p, const char *key) {
    if (!p || *(p = blank(p)) != '{') return NULL;
    p = blank(p + 1);
    while (*p == '"') {
        int found = is_text(p, key);
        p = blank(blank(after(p, 0)) + 1);
        if (found) return p;
        p = blank(after(p, 0));
        if (*p == ',') p = blank(p + 1);
    }
    return NULL;
}

/* A hex float in a string: strtod reads it. */
static double number(const char *p) { return p && *p == '"' ? strtod(p + 1, NULL) : NAN; }

/* Read the numbers of the array at p; return their count, or -1 if there are more than `most` or no array. */
static int numbers(const char *p, double *to, int most) {
    int n = 0;
    if (!p || *blank(p) != '[') return -1;
    for (p = first(p); p; p = next(p)) {
        if (n == most) return -1;
        to[n++] = number(p);
    }
    return n;
}

/* ---- Problems: the vector field f = B grad H. ---- */

/* Terms of all polynomials of a message, read once, because a step evaluates them some fifty times. */
static struct { double coefficient; int e[MAXD]; } *terms;
static size_t used, room;

typedef struct {
    size_t from, to; /* among the terms */
} Polynomial;

typedef struct {
    enum { OSCILLATOR, PENDULUM, RIGID_BODY, POLYNOMIAL } kind;
    int d, m, entries, row[MAXE], column[MAXE];
    double c[MAXM], inertia[3];
    Polynomial hamiltonian, structure[MAXE]; /* B above its diagonal */
} Problem;

/* The value of the polynomial at y, or of its derivative by y_k if k >= 0. */
static double polynomial(Polynomial p, int d, const double *y, int k) {
    double sum = 0;
    for (size_t n = p.from; n < p.to; n++) {
        double term = terms[n].coefficient;
        for (int i = 0; i < d; i++) {
            int e = terms[n].e[i];
            if (i == k) term *= e--;
            for (; e > 0; e--) term *= y[i];
        }
        sum += term;
    }
    return sum;
}

static void field(const Problem *P, const double *y, double *f) {
    double g[MAXD];
    if (P->kind == OSCILLATOR || P->kind == PENDULUM) { /* B = ((0, -1), (1, 0)), y = (p, q) */
        f[0] = -(P->kind == PENDULUM ? sin(y[1]) : y[1]);
        f[1] = y[0];
    } else if (P->kind == RIGID_BODY) { /* B = hat(y), H = sum y_i^2 / (2 I_i) */
        for (int i = 0; i < 3; i++) g[i] = y[i] / P->inertia[i];
        f[0] = y[1] * g[2] - y[2] * g[1];
        f[1] = y[2] * g[0] - y[0] * g[2];
        f[2] = y[0] * g[1] - y[1] * g[0];
    } else {
        for (int i = 0; i < P->d; i++) g[i] = polynomial(P->hamiltonian, P->d, y, i), f[i] = 0;
        for (int n = 0; n < P->entries; n++) { /* B_ji = -B_ij */
            double b = polynomial(P->structure[n], P->d, y, -1);
            f[P->row[n]] += b * g[P->column[n]];
            f[P->column[n]] -= b * g[P->row[n]];
        }
    }
}

/* Read the polynomial [[exponents, coefficient], ...] at p; return 1 if each term has d exponents, else 0. */
static int read_terms(const char *p, int d, Polynomial *to) {
    to->from = to->to = used;
    if (!p || *p != '[') return 0;
    for (p = first(p); p; p = next(p)) {
        int n = 0;
        const char *exponents = first(p);
        if (!exponents || !next(exponents)) return 0;
        if (used == room && !(terms = realloc(terms, (room = 2 * room + 64) * sizeof *terms))) exit(1);
        for (const char *q = first(exponents); q; q = next(q)) {
            if (n == d) return 0;
            terms[used].e[n++] = atoi(q);
        }
        if (n != d) return 0;
        terms[used].coefficient = number(next(exponents));
        to->to = ++used;
    }
    return 1;
}

/* Read a problem; return NULL, or the reason why it is skipped. */
static const char *read_problem(const char *p, Problem *P) {
    const char *name = member(p, "name"), *parameters = member(p, "parameters");
    if (name) {
        P->d = 2;
        if (is_text(name, "harmonic-oscillator")) P->kind = OSCILLATOR;
        else if (is_text(name, "pendulum")) P->kind = PENDULUM;
        else if (is_text(name, "rigid-body")) {
            P->kind = RIGID_BODY, P->d = 3;
            if (numbers(member(parameters, "inertia"), P->inertia, 3) != 3) return "no three moments of inertia";
        } else return "unknown problem";
        P->m = numbers(member(parameters, "noise"), P->c, MAXM);
    } else {
        const char *dimension = member(p, "dimension");
        P->kind = POLYNOMIAL;
        P->d = dimension ? atoi(dimension) : 0;
        if (P->d < 1 || P->d > MAXD) return "more than 16 dimensions, or none";
        const char *structure = member(p, "structure");
        used = 0;
        if (!read_terms(member(p, "hamiltonian"), P->d, &P->hamiltonian) || !structure || *structure != '[')
            return "no polynomial data";
        P->entries = 0;
        for (const char *q = first(structure); q; q = next(q), P->entries++) { /* [i, j, terms], i < j */
            const char *row = first(q), *column = row ? next(row) : NULL, *entry = column ? next(column) : NULL;
            if (P->entries == MAXE || !read_terms(entry, P->d, &P->structure[P->entries]) || atoi(row) < 0 ||
                atoi(row) >= P->d || atoi(column) < 0 || atoi(column) >= P->d)
                return "structure without [row, column, terms]";
            P->row[P->entries] = atoi(row), P->column[P->entries] = atoi(column);
        }
        P->m = numbers(member(p, "noise"), P->c, MAXM);
    }
    return P->m < 0 ? "more than 16 noises, or no noise list" : NULL;
}

/* ---- The scheme. ---- */

/* Solve A x = b in place by elimination with row exchanges; return 0 if A is singular. */
static int eliminate(int d, double A[MAXD][MAXD], double *b) {
    for (int k = 0; k < d; k++) {
        int pivot = k;
        for (int i = k + 1; i < d; i++)
            if (fabs(A[i][k]) > fabs(A[pivot][k])) pivot = i;
        if (!(fabs(A[pivot][k]) > 0)) return 0;
        for (int j = 0; j < d; j++) {
            double t = A[k][j];
            A[k][j] = A[pivot][j], A[pivot][j] = t;
        }
        double t = b[k];
        b[k] = b[pivot], b[pivot] = t;
        for (int i = k + 1; i < d; i++) {
            double factor = A[i][k] / A[k][k];
            for (int j = k; j < d; j++) A[i][j] -= factor * A[k][j];
            b[i] -= factor * b[k];
        }
    }
    for (int i = d - 1; i >= 0; i--) {
        for (int j = i + 1; j < d; j++) b[i] -= A[i][j] * b[j];
        b[i] /= A[i][i];
    }
    return 1;
}

/* Compute y1 by Newton's method on the unknown z = y1 - y0, iterated until only rounding is left: a solver that
 * stops at a tolerance makes invariants drift. Return NULL, or the reason why there is no y1. */
static const char *step(const Problem *P, const double *y, double h, const double *dW, double *y1) {
    const int d = P->d;
    double z[MAXD] = {0}, D = h, before = HUGE_VAL;
    for (int j = 0; j < P->m; j++) D += P->c[j] * dW[j];
    for (int n = 0; n < MAX_ITERATIONS; n++) {
        double middle[MAXD], f[MAXD], shifted[MAXD], F[MAXD], A[MAXD][MAXD], scale = 0, size = 0, residual = 0;
        for (int i = 0; i < d; i++) {
            middle[i] = y[i] + 0.5 * z[i];
            scale = fmax(scale, fabs(y[i]) + fabs(z[i]));
        }
        field(P, middle, f);
        for (int i = 0; i < d; i++) {
            F[i] = z[i] - D * f[i];
            residual = fmax(residual, fabs(F[i]));
        }
        if (residual == 0) break; /* y0 at rest, or D = 0: exact, even if the Jacobian is singular */
        /* The Jacobian of F by differences: their error costs an iteration, but no accuracy. */
        for (int k = 0; k < d; k++) {
            double save = middle[k], width = sqrt(DBL_EPSILON) * (scale > 0 ? scale : 1);
            middle[k] += width;
            width = middle[k] - save;
            field(P, middle, shifted);
            middle[k] = save;
            for (int i = 0; i < d; i++) A[i][k] = (i == k) - 0.5 * D * (shifted[i] - f[i]) / width;
        }
        if (!eliminate(d, A, F)) return "singular Jacobian";
        for (int i = 0; i < d; i++) {
            if (!isfinite(F[i])) return "overflow";
            size = fmax(size, fabs(F[i]));
        }
        /* Done if the correction is far below rounding, or is small and no longer shrinks. Its size is that of its
         * largest component, as for rounding: a component near zero would end the iteration too soon. */
        if (size <= DBL_EPSILON / 256 * scale || (size <= sqrt(DBL_EPSILON) * scale && size >= 0.5 * before)) break;
        before = size;
        for (int i = 0; i < d; i++) z[i] -= F[i];
        if (n == MAX_ITERATIONS - 1) return "no convergence";
    }
    for (int i = 0; i < d; i++) y1[i] = y[i] + z[i];
    return NULL;
}

/* ---- The conversation: one line in, one line out. ---- */

static void say(int id, const char *key, const char *reason) {
    printf("{\"id\":%d,\"%s\":\"%s\"}\n", id, key, reason);
}

static void answer_step(int id, const char *message) {
    Problem P;
    const char *reason = read_problem(member(message, "problem"), &P);
    if (reason) {
        say(id, "skip", reason);
        return;
    }
    /* The states are kept until all are there: one step that fails makes the whole answer an error. */
    size_t count = 0, n = 0;
    for (const char *p = first(member(message, "steps")); p; p = next(p)) count++;
    double *states = malloc((count * P.d + 1) * sizeof *states);
    for (const char *p = first(member(message, "steps")); p && !reason; p = next(p), n++) {
        double y[MAXD], dW[MAXM];
        if (!states) reason = "out of memory";
        else if (numbers(member(p, "y"), y, MAXD) != P.d) reason = "y of another dimension";
        else if (numbers(member(p, "dW"), dW, MAXM) != P.m) reason = "dW of another number of noises";
        else reason = step(&P, y, number(member(p, "h")), dW, states + n * P.d);
    }
    if (reason) say(id, "error", reason);
    else {
        printf("{\"id\":%d,\"y_next\":[", id);
        for (size_t k = 0; k < n; k++)
            for (int i = 0; i < P.d; i++)
                printf("%s\"%a\"%s", i ? "," : k ? ",[" : "[", states[k * P.d + i], i == P.d - 1 ? "]" : "");
        printf("]}\n");
    }
    free(states);
}

static const char HELLO[] =
    "\"protocol\":1,\"scheme\":\"midpoint-c\",\"source\":\"Milstein, Repin and Tretyakov (2002), equation (3.4)\","
    "\"claims\":[\"contract\",\"identity\",\"casimir\",\"midpoint\",\"symmetry\"],\"mean_square_order\":1,"
    "\"problems\":[\"harmonic-oscillator\",\"rigid-body\",\"pendulum\"],\"polynomial\":true,\"max_steps\":256";

/* The next line, of any length, without its end; NULL at the end of the input. */
static char *read_line(char **line, size_t *size) {
    size_t n = 0;
    for (;;) {
        if (n + 2 > *size) {
            char *more = realloc(*line, *size = 2 * *size + 4096);
            if (!more) exit(1);
            *line = more;
        }
        if (!fgets(*line + n, (int)(*size - n), stdin)) return n ? *line : NULL;
        n += strlen(*line + n);
        if (n && (*line)[n - 1] == '\n') return *line;
    }
}

int main(void) {
    char *line = NULL;
    size_t size = 0;
    while (read_line(&line, &size)) {
        const char *end = after(line, 0), *number_of = end ? member(line, "id") : NULL, *type = NULL;
        int id = number_of ? atoi(number_of) : -1;
        if (end) type = member(line, "type");
        if (is_text(type, "stop")) break;
        if (is_text(type, "hello")) printf("{\"id\":%d,%s}\n", id, HELLO);
        else if (is_text(type, "step")) answer_step(id, line);
        else say(id, "error", "unknown type of message");
        fflush(stdout); /* without it the answer waits in a buffer, and sepv for the answer */
    }
    free(line);
    return 0;
}
