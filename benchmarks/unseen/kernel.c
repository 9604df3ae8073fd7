/* Tree.dynamics of tree.py, state by state: recursive Newton-Euler and composite bodies in the world's frame.
   Optional: tree.py does the same in numpy, and `python -m unseen check` compares the two. */
#include <math.h>
#include <string.h>
#define MOST 16

static void cross(const double *a, const double *b, double *c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void times(const double *A, const double *B, double *C) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) C[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

static void apply(const double *A, const double *x, double *y) {
    for (int i = 0; i < 3; i++) y[i] = dot(A + 3 * i, x);
}

/* Momentum about the world's origin of a body (mass m, first moment h, inertia J about the origin) at velocity V. */
static void momentum(double m, const double *h, const double *J, const double *V, double *p) {
    double a[3], b[3];
    apply(J, V, p);
    cross(h, V + 3, a);
    cross(V, h, b);
    for (int k = 0; k < 3; k++) p[k] += a[k], p[3 + k] = m * V[3 + k] + b[k];
}

void dynamics(int batch, int n, const int *parent, const int *hinge, const double *axis, const double *rot,
              const double *pos, const double *mass, const double *com, const double *inertia, const double *gravity,
              const double *q, const double *v, double *M, double *c) {
    for (int b = 0; b < batch; b++, q += n, v += n, M += n * n, c += n) {
        double R[MOST][9], P[MOST][3], S[MOST][6], V[MOST][6], A[MOST][6], m[MOST], h[MOST][3], J[MOST][9], F[MOST][6];
        for (int i = 0; i < n; i++) {
            double base[9], w[3], t[9], x[3], y[3];
            const double *ax = axis + 3 * i;
            int p = parent[i];
            if (p < 0) {
                memcpy(base, rot + 9 * i, sizeof base);
                memcpy(P[i], pos + 3 * i, sizeof P[i]);
            } else {
                times(R[p], rot + 9 * i, base);
                apply(R[p], pos + 3 * i, P[i]);
                for (int k = 0; k < 3; k++) P[i][k] += P[p][k];
            }
            apply(base, ax, w);
            memset(S[i], 0, sizeof S[i]);
            if (hinge[i]) {
                double s = sin(q[i]), d = 1 - cos(q[i]);
                double turn[9] = {1 - d * (ax[1] * ax[1] + ax[2] * ax[2]), d * ax[0] * ax[1] - s * ax[2],
                                  d * ax[0] * ax[2] + s * ax[1],           d * ax[0] * ax[1] + s * ax[2],
                                  1 - d * (ax[0] * ax[0] + ax[2] * ax[2]), d * ax[1] * ax[2] - s * ax[0],
                                  d * ax[0] * ax[2] - s * ax[1],           d * ax[1] * ax[2] + s * ax[0],
                                  1 - d * (ax[0] * ax[0] + ax[1] * ax[1])};
                times(base, turn, R[i]);
                memcpy(S[i], w, sizeof w);
                cross(P[i], w, S[i] + 3);
            } else {
                memcpy(R[i], base, sizeof base);
                for (int k = 0; k < 3; k++) P[i][k] += w[k] * q[i], S[i][3 + k] = w[k];
            }
            apply(R[i], com + 3 * i, x);
            for (int k = 0; k < 3; k++) x[k] += P[i][k], h[i][k] = mass[i] * x[k];
            m[i] = mass[i];
            times(R[i], inertia + 9 * i, t);
            for (int j = 0; j < 3; j++)
                for (int k = 0; k < 3; k++)
                    J[i][3 * j + k] = dot(t + 3 * j, R[i] + 3 * k) + mass[i] * ((j == k) * dot(x, x) - x[j] * x[k]);
            double Sv[6], one[3], two[3];
            for (int k = 0; k < 6; k++) {
                Sv[k] = S[i][k] * v[i];
                V[i][k] = Sv[k] + (p < 0 ? 0 : V[p][k]);
                A[i][k] = p < 0 ? (k < 3 ? 0 : -gravity[k - 3]) : A[p][k];
            }
            cross(V[i], Sv, y);
            cross(V[i], Sv + 3, one);
            cross(V[i] + 3, Sv, two);
            for (int k = 0; k < 3; k++) A[i][k] += y[k], A[i][3 + k] += one[k] + two[k];
            double g[6];
            momentum(m[i], h[i], J[i], A[i], F[i]);
            momentum(m[i], h[i], J[i], V[i], g);
            cross(V[i], g, one);
            cross(V[i] + 3, g + 3, two);
            cross(V[i], g + 3, y);
            for (int k = 0; k < 3; k++) F[i][k] += one[k] + two[k], F[i][3 + k] += y[k];
        }
        memset(M, 0, sizeof(double) * n * n);
        for (int i = n - 1; i >= 0; i--) {
            double g[6];
            c[i] = dot(S[i], F[i]) + dot(S[i] + 3, F[i] + 3);
            momentum(m[i], h[i], J[i], S[i], g);
            for (int j = i; j >= 0; j = parent[j])
                M[i * n + j] = M[j * n + i] = dot(S[j], g) + dot(S[j] + 3, g + 3);
            int p = parent[i];
            if (p < 0) continue;
            m[p] += m[i];
            for (int k = 0; k < 3; k++) h[p][k] += h[i][k];
            for (int k = 0; k < 6; k++) F[p][k] += F[i][k];
            for (int k = 0; k < 9; k++) J[p][k] += J[i][k];
        }
    }
}
