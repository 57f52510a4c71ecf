/* A client of sepv's protocol (docs/protocol.md) for C, C++ and Fortran, without a library. It reads the messages, knows
 * the problems, and solves an implicit step; the scheme is one function, `increment`, in a file of its own:
 *
 *     examples/midpoint.c     cc -O2 -o midpoint examples/midpoint.c -lm
 *     examples/midpoint.f90   cc -O2 -c -x c examples/client.h -o client.o && gfortran -o midpoint examples/midpoint.f90 client.o
 *
 * An explicit scheme ignores `z` in `increment`; the iteration then ends after its second evaluation.
 */
#ifndef SEPV_CLIENT_H
#define SEPV_CLIENT_H
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { MAXD = 16, MAXE = MAXD * (MAXD - 1) / 2, MAXM = 16, MAX_ITERATIONS = 40 };

typedef struct Problem Problem;

/* ---- What the scheme's file defines. ---- */

/* The members of the answer to "hello" after the id and the protocol, as JSON: "scheme", "claims", ... */
extern const char hello[];

/* R (d) with y1 = y + R for a step with the random step delta = h + sum_j c_j dW_j, where z = y1 - y is the unknown. */
void increment(const Problem *problem, int d, const double *y, const double *z, double delta, double *R);

/* ---- What this file offers to the scheme. ---- */

/* The field f(y) = B(y) grad H(y), (d). */
void field(const Problem *problem, const double *y, double *f);
/* The gradient of H, (d), and the product B(y) v, (d). */
void gradient(const Problem *problem, const double *y, double *g);
void structure(const Problem *problem, const double *y, const double *v, double *product);
/* The average of grad H on the segment from y to y + z, (d), exact to rounding for polynomials H up to degree 20. */
void mean_gradient(const Problem *problem, const double *y, const double *z, double *g);

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

/* ---- Problems. ---- */

/* Terms of all polynomials of a message, read once, because a step evaluates them some fifty times. */
typedef struct {
    double coefficient;
    int e[MAXD];
} Term;
static Term *terms;
static size_t used, room;

typedef struct {
    size_t from, to; /* among the terms */
} Polynomial;

enum Kind { OSCILLATOR, PENDULUM, RIGID_BODY, POLYNOMIAL };

struct Problem {
    enum Kind kind;
    int d, m, entries, row[MAXE], column[MAXE];
    double c[MAXM], inertia[3];
    Polynomial hamiltonian, structure[MAXE]; /* B above its diagonal */
};

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

void gradient(const Problem *P, const double *y, double *g) {
    if (P->kind == OSCILLATOR || P->kind == PENDULUM) { /* y = (p, q) */
        g[0] = y[0];
        g[1] = P->kind == PENDULUM ? sin(y[1]) : y[1];
    } else if (P->kind == RIGID_BODY) { /* H = sum y_i^2 / (2 I_i) */
        for (int i = 0; i < 3; i++) g[i] = y[i] / P->inertia[i];
    } else
        for (int i = 0; i < P->d; i++) g[i] = polynomial(P->hamiltonian, P->d, y, i);
}

void structure(const Problem *P, const double *y, const double *v, double *f) {
    if (P->kind == OSCILLATOR || P->kind == PENDULUM) { /* B = ((0, -1), (1, 0)) */
        f[0] = -v[1];
        f[1] = v[0];
    } else if (P->kind == RIGID_BODY) { /* B = hat(y) */
        f[0] = y[1] * v[2] - y[2] * v[1];
        f[1] = y[2] * v[0] - y[0] * v[2];
        f[2] = y[0] * v[1] - y[1] * v[0];
    } else {
        for (int i = 0; i < P->d; i++) f[i] = 0;
        for (int n = 0; n < P->entries; n++) { /* B_ji = -B_ij */
            double b = polynomial(P->structure[n], P->d, y, -1);
            f[P->row[n]] += b * v[P->column[n]];
            f[P->column[n]] -= b * v[P->row[n]];
        }
    }
}

void field(const Problem *P, const double *y, double *f) {
    double g[MAXD];
    gradient(P, y, g);
    structure(P, y, g, f);
}

void mean_gradient(const Problem *P, const double *y, const double *z, double *g) {
    /* Gauss and Legendre's rule with 10 nodes integrates polynomials of degree 19: the nodes below 1/2, their weights. */
    static const double node[5] = {0.01304673574141414, 0.067468316655507745, 0.1602952158504878, 0.2833023029353764, 0.42556283050918439};
    static const double weight[5] = {0.033335672154344069, 0.074725674575290297, 0.10954318125799102, 0.13463335965499818, 0.14776211235737644};
    if (P->kind == PENDULUM) { /* the mean of sin over [q, q + z] is sin(q + z/2) sin(x)/x, x = z/2 */
        double x = z[1] / 2;
        g[0] = y[0] + z[0] / 2;
        g[1] = sin(y[1] + x) * (fabs(x) > 1e-8 ? sin(x) / x : 1);
        return;
    }
    for (int i = 0; i < P->d; i++) g[i] = 0;
    for (int n = 0; n < 10; n++) {
        double at[MAXD] = {0}, value[MAXD], x = n < 5 ? node[n] : 1 - node[9 - n];
        for (int i = 0; i < P->d; i++) at[i] = y[i] + x * z[i];
        gradient(P, at, value);
        for (int i = 0; i < P->d; i++) g[i] += weight[n < 5 ? n : 9 - n] * value[i];
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
        if (used == room && !(terms = (Term *)realloc(terms, (room = 2 * room + 64) * sizeof *terms))) exit(1);
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

/* ---- The step. ---- */

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

/* Solve z = R(z) by Newton's method, iterated until only rounding is left: a solver that stops at a tolerance makes
 * invariants drift. Return NULL, or the reason why there is no solution. */
static const char *step(const Problem *P, const double *y, double h, const double *dW, double *y1) {
    const int d = P->d;
    double z[MAXD] = {0}, D = h, before = HUGE_VAL;
    for (int j = 0; j < P->m; j++) D += P->c[j] * dW[j];
    for (int n = 0; n < MAX_ITERATIONS; n++) {
        double R[MAXD], shifted[MAXD], F[MAXD], A[MAXD][MAXD], scale = 0, size = 0, residual = 0;
        for (int i = 0; i < d; i++) scale = fmax(scale, fabs(y[i]) + fabs(z[i]));
        increment(P, d, y, z, D, R);
        for (int i = 0; i < d; i++) {
            F[i] = z[i] - R[i];
            residual = fmax(residual, fabs(F[i]));
        }
        if (residual == 0) break; /* y at rest, or D = 0: exact, even if the Jacobian is singular */
        /* The Jacobian of F by differences: their error costs an iteration, but no accuracy. */
        for (int k = 0; k < d; k++) {
            double save = z[k], width = sqrt(DBL_EPSILON) * (scale > 0 ? scale : 1);
            z[k] += width;
            width = z[k] - save;
            increment(P, d, y, z, D, shifted);
            z[k] = save;
            for (int i = 0; i < d; i++) A[i][k] = (i == k) - (shifted[i] - R[i]) / width;
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
    double *states = (double *)malloc((count * P.d + 1) * sizeof *states);
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

/* The next line, of any length, without its end; NULL at the end of the input. */
static char *read_line(char **line, size_t *size) {
    size_t n = 0;
    for (;;) {
        if (n + 2 > *size) {
            char *more = (char *)realloc(*line, *size = 2 * *size + 4096);
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
        if (is_text(type, "hello")) printf("{\"id\":%d,\"protocol\":1,%s}\n", id, hello);
        else if (is_text(type, "step")) answer_step(id, line);
        else say(id, "error", "unknown type of message");
        fflush(stdout); /* without it the answer waits in a buffer, and sepv for the answer */
    }
    free(line);
    return 0;
}

#ifdef __cplusplus
}
#endif
#endif
