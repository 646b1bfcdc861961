/* Steps of the chain. Planar bodies 1..N hinged in a row, 0 the clamp; Newton's step costs O(N): a sweep from tip to
 * clamp eliminates every body, the way back gives the answer. One step is SDIRK2 (Alexander 1977), L-stable.
 * Work space is on the stack: nothing is allocated, nothing is static but constants, so models may run side by side. */

enum { TAU, TAU_THETA, TAU_RATE, TAU_PRESSURE, ADDED, ADDED_THETA, FIXED, COLUMNS = 6 + 5 * M + M * M };
enum { LENGTH, MASS, ALONG, ACROSS, INERTIA, FORCE_ALONG, FORCE_ACROSS, ADDED_ALONG };
#define COUNT (N + 2)
#define STATES (M > 0 ? M : 1)
#define SEEN (WITH_FORCE ? 7 : 3) /* what a body sees of its inner neighbour */

typedef struct {
    double ux, uy, acx, acy, adx, ady, fx, fy, torque, residual, beta, xfx, xfy, stiff, tau_p, z_torque, step, line_step;
    double kx[3], gamma[7], e[7], k[3][7];
} body_t;

typedef struct {
    body_t body[COUNT];
    double phi[N + 1], om[N + 1], al[N + 1];
    double out[N][COLUMNS], force[N][2][5], motion[N][4];
    double z[N][STATES], z_star[N][STATES], dz[N][STATES], zc[N][STATES], sx[N][STATES], zp[N][STATES];
} work_t;

/* The next hinge from this one, and that by the angle; the clamp turns about a point beside the hinge line. */
static void to_hinge(const body_t *b, double length, double pivot, double *h, double *g) {
    h[0] = length * b->ux + pivot * b->uy;
    h[1] = length * b->uy - pivot * b->ux;
    g[0] = h[1];
    g[1] = -h[0];
}

static void kinematics(work_t *w) {
    double px = PIVOT - CHAIN[0][FORCE_ACROSS], py = 0, vx = 0, vy = 0, ax = 0, ay = 0;
    for (int i = 0; i <= N; i++) {
        body_t *b = &w->body[i];
        const double ux = -sin(w->phi[i]), uy = -cos(w->phi[i]), nx = uy, ny = -ux;
        const double om = w->om[i], al = w->al[i], w2 = om * om;
        double h[2], g[2];
        b->ux = ux;
        b->uy = uy;
        if (i == 0) to_hinge(b, BASE_LENGTH, PIVOT, h, g);
        if (i > 0) {
            const double *c = CHAIN[i - 1];
            double along = c[ALONG], across = c[ACROSS];
            to_hinge(b, c[LENGTH], 0, h, g);
            b->acx = ax + al * (along * nx + across * ux) - w2 * (along * ux - across * nx) - GRAVITY[0];
            b->acy = ay + al * (along * ny + across * uy) - w2 * (along * uy - across * ny) - GRAVITY[1];
#if WITH_ADDED
            along = c[ADDED_ALONG];
            b->adx = ax + al * (along * nx + across * ux) - w2 * (along * ux - across * nx) - GRAVITY[0];
            b->ady = ay + al * (along * ny + across * uy) - w2 * (along * uy - across * ny) - GRAVITY[1];
#endif
            along = c[FORCE_ALONG];
            across = c[FORCE_ACROSS];
            w->motion[i - 1][0] = px + along * ux - across * nx;
            w->motion[i - 1][1] = py + along * uy - across * ny;
            w->motion[i - 1][2] = vx + om * (along * nx + across * ux);
            w->motion[i - 1][3] = vy + om * (along * ny + across * uy);
        }
        ax += al * g[0] - w2 * h[0];
        ay += al * g[1] - w2 * h[1];
        px += h[0];
        py += h[1];
        vx += om * g[0];
        vy += om * g[1];
    }
}

/* How the next hinge moves with body i, and what everything beyond it answers. */
static void next_hinge(work_t *w, int i, double length, double pivot, double ca, double co, double cp) {
    body_t *b = &w->body[i];
    const double om = w->om[i], al = w->al[i], w2 = om * om;
    double h[2], g[2];
    to_hinge(b, length, pivot, h, g);
    b->e[0] = ca * g[0] - cp * (al * h[0] + w2 * g[0]) - 2 * co * om * h[0];
    b->e[1] = ca * g[1] - cp * (al * h[1] + w2 * g[1]) - 2 * co * om * h[1];
    b->e[2] = 1;
    b->e[3] = co * g[0] - cp * om * h[0];
    b->e[4] = co * g[1] - cp * om * h[1];
    b->e[5] = cp * g[0];
    b->e[6] = cp * g[1];
    for (int a = 0; a < 3; a++) {
        b->kx[a] = 0;
        for (int s = 0; s < SEEN; s++) b->kx[a] += w->body[i + 1].k[a][s] * b->e[s];
    }
}

/* Residual of every body and the factors of the linearised chain, from tip to clamp. */
static void factor(work_t *w, double ca, double co, double cp) {
    memset(&w->body[N + 1], 0, sizeof(body_t));
    for (int i = N; i > 0; i--) {
        body_t *b = &w->body[i];
        const body_t *next = &w->body[i + 1];
        const double *c = CHAIN[i - 1], *out = w->out[i - 1];
        const double length = c[LENGTH], along = c[ALONG], across = c[ACROSS], mass = c[MASS];
        next_hinge(w, i, length, 0, ca, co, cp);
        const double ux = b->ux, uy = b->uy, nx = uy, ny = -ux, om = w->om[i], al = w->al[i], w2 = om * om;
        const double rx = along * ux - across * nx, ry = along * uy - across * ny;
        const double qx = along * nx + across * ux, qy = along * ny + across * uy;
        const double gx = ca * qx - cp * (al * rx + w2 * qx) - 2 * co * om * rx;
        const double gy = ca * qy - cp * (al * ry + w2 * qy) - 2 * co * om * ry;
        const double moment = b->acx * qx + b->acy * qy;
        b->residual = c[INERTIA] * al + mass * moment + length * (nx * next->fx + ny * next->fy) + next->torque
            - out[TAU] + next->z_torque - b->z_torque;
        double beta = c[INERTIA] * ca + mass * (gx * qx + gy * qy - (b->acx * rx + b->acy * ry) * cp)
            + length * (nx * b->kx[0] + ny * b->kx[1] - (ux * next->fx + uy * next->fy) * cp) + b->kx[2] - b->stiff;
        for (int s = 0; s < SEEN; s++)
            b->gamma[s] = length * (nx * next->k[0][s] + ny * next->k[1][s]) + next->k[2][s];
        b->gamma[2] = b->stiff;
        b->gamma[0] += mass * qx;
        b->gamma[1] += mass * qy;
        b->xfx = mass * gx + b->kx[0];
        b->xfy = mass * gy + b->kx[1];
        b->fx = mass * b->acx + next->fx;
        b->fy = mass * b->acy + next->fy;
        b->torque = out[TAU];
#if WITH_FORCE
        {
            const double fa = c[FORCE_ALONG], fc = c[FORCE_ACROSS];
            const double sx = fa * ux - fc * nx, sy = fa * uy - fc * ny, tx = fa * nx + fc * ux, ty = fa * ny + fc * uy;
            const double(*f)[5] = (const double(*)[5])w->force[i - 1];
            const double vx = co * tx - cp * om * sx, vy = co * ty - cp * om * sy;
            const double dfx = (f[0][1] * tx + f[0][2] * ty) * cp + f[0][3] * vx + f[0][4] * vy;
            const double dfy = (f[1][1] * tx + f[1][2] * ty) * cp + f[1][3] * vx + f[1][4] * vy;
            b->residual -= f[0][0] * tx + f[1][0] * ty;
            b->fx -= f[0][0];
            b->fy -= f[1][0];
            beta += (f[0][0] * sx + f[1][0] * sy) * cp - (dfx * tx + dfy * ty);
            b->xfx -= dfx;
            b->xfy -= dfy;
            for (int s = 0; s < 2; s++) {
                b->gamma[5 + s] -= f[0][1 + s] * tx + f[1][1 + s] * ty;
                b->gamma[3 + s] -= f[0][3 + s] * tx + f[1][3 + s] * ty;
            }
        }
#endif
#if WITH_ADDED
        const double added = out[ADDED], grow = out[ADDED_THETA] * cp, aa = c[ADDED_ALONG];
        {
            const double sx = aa * ux - across * nx, sy = aa * uy - across * ny;
            const double tx = aa * nx + across * ux, ty = aa * ny + across * uy;
            const double vx = ca * tx - cp * (al * sx + w2 * tx) - 2 * co * om * sx;
            const double vy = ca * ty - cp * (al * sy + w2 * ty) - 2 * co * om * sy;
            const double turn = b->adx * tx + b->ady * ty;
            b->residual += added * turn;
            b->fx += added * b->adx;
            b->fy += added * b->ady;
            b->gamma[0] += added * tx;
            b->gamma[1] += added * ty;
            b->gamma[2] -= grow * turn;
            beta += added * (vx * tx + vy * ty - (b->adx * sx + b->ady * sy) * cp) + grow * turn;
            b->xfx += added * vx + grow * b->adx;
            b->xfy += added * vy + grow * b->ady;
        }
#endif
        b->beta = beta;
        for (int s = 0; s < SEEN; s++) {
            const double share = -b->gamma[s] / beta;
            b->k[0][s] = next->k[0][s] + b->xfx * share;
            b->k[1][s] = next->k[1][s] + b->xfy * share;
            b->k[2][s] = b->stiff * share;
        }
        b->k[0][2] = -b->xfx * b->gamma[2] / beta;
        b->k[1][2] = -b->xfy * b->gamma[2] / beta;
        b->k[2][2] -= b->stiff;
        b->k[0][0] += mass;
        b->k[1][1] += mass;
#if WITH_ADDED
        b->k[0][2] -= grow * b->adx;
        b->k[1][2] -= grow * b->ady;
        b->k[0][0] += added;
        b->k[1][1] += added;
#endif
#if WITH_FORCE
        for (int a = 0; a < 2; a++)
            for (int s = 0; s < 2; s++) {
                b->k[a][5 + s] -= w->force[i - 1][a][1 + s];
                b->k[a][3 + s] -= w->force[i - 1][a][3 + s];
            }
#endif
    }
#if WITH_BASE
    {
        body_t *b = &w->body[0];
        const body_t *next = &w->body[1];
        double h[2], g[2];
        next_hinge(w, 0, BASE_LENGTH, PIVOT, ca, co, cp);
        to_hinge(b, BASE_LENGTH, PIVOT, h, g);
        b->residual =
            w->phi[0] + COMPLIANCE * (next->torque + next->z_torque + g[0] * next->fx + g[1] * next->fy);
        b->beta = cp
            + COMPLIANCE
                * (b->kx[2] + g[0] * b->kx[0] + g[1] * b->kx[1] - (h[0] * next->fx + h[1] * next->fy) * cp);
    }
#endif
}

/* x = -J^-1 right, with the factors of `factor`. */
static void solve(const work_t *w, const double *right, double *x) {
    double fx = 0, fy = 0, torque = 0, d[7];
    for (int i = N; i > 0; i--) {
        const body_t *b = &w->body[i];
        x[i] = -(right[i] + CHAIN[i - 1][LENGTH] * (b->uy * fx - b->ux * fy) + torque) / b->beta;
        fx += b->xfx * x[i];
        fy += b->xfy * x[i];
        torque = b->stiff * x[i];
    }
    x[0] = 0;
#if WITH_BASE
    double h[2], g[2];
    to_hinge(&w->body[0], BASE_LENGTH, PIVOT, h, g);
    x[0] = -(right[0] + COMPLIANCE * (g[0] * fx + g[1] * fy + torque)) / w->body[0].beta;
#endif
    for (int s = 0; s < SEEN; s++) d[s] = x[0] == 0 ? 0 : w->body[0].e[s] * x[0];
    for (int i = 1; i <= N; i++) {
        const body_t *b = &w->body[i];
        double total = 0;
        for (int s = 0; s < SEEN; s++) total += b->gamma[s] * d[s];
        x[i] -= total / b->beta;
        for (int s = 0; s < SEEN; s++) d[s] += b->e[s] * x[i];
        d[2] = x[i];
    }
}

/* Torque's derivative with the hidden states eliminated: z = z* + s g. */
static void joint_factors(work_t *w, double s, double co, double cp) {
    for (int j = 0; j < N; j++) {
        const double *out = w->out[j];
        double stiff = out[TAU_THETA] * cp + out[TAU_RATE] * co, by_p = out[TAU_PRESSURE], correction = 0;
#if M > 0
        double a[M][M], right[M][3];
        for (int r = 0; r < M; r++) {
            const double *g = out + FIXED + M + 4 * r;
            for (int c = 0; c < M; c++) a[r][c] = (r == c) - s * out[FIXED + M + 4 * M + r * M + c];
            right[r][0] = s * (g[1] * cp + g[2] * co);
            right[r][1] = s * g[3];
            right[r][2] = -(w->z[j][r] - w->z_star[j][r] - s * g[0]);
        }
        for (int c = 0; c < M; c++) { /* Gauss-Jordan with row pivoting */
            int pivot = c;
            for (int r = c + 1; r < M; r++)
                if (fabs(a[r][c]) > fabs(a[pivot][c])) pivot = r;
            for (int k = 0; k < M; k++) {
                const double swap = a[c][k];
                a[c][k] = a[pivot][k];
                a[pivot][k] = swap;
            }
            for (int k = 0; k < 3; k++) {
                const double swap = right[c][k];
                right[c][k] = right[pivot][k];
                right[pivot][k] = swap;
            }
            const double scale = 1 / a[c][c];
            for (int k = 0; k < M; k++) a[c][k] *= scale;
            for (int k = 0; k < 3; k++) right[c][k] *= scale;
            for (int r = 0; r < M; r++) {
                const double part = a[r][c];
                if (r == c || part == 0) continue;
                for (int k = 0; k < M; k++) a[r][k] -= part * a[c][k];
                for (int k = 0; k < 3; k++) right[r][k] -= part * right[c][k];
            }
        }
        for (int r = 0; r < M; r++) {
            w->sx[j][r] = right[r][0];
            w->zp[j][r] = right[r][1];
            w->zc[j][r] = right[r][2];
            stiff += out[FIXED + r] * right[r][0];
            by_p += out[FIXED + r] * right[r][1];
            correction += out[FIXED + r] * right[r][2];
        }
#else
        (void)s;
#endif
        w->body[j + 1].stiff = stiff;
        w->body[j + 1].tau_p = by_p;
        w->body[j + 1].z_torque = correction;
    }
}

static void evaluate(work_t *w, double pressure) {
    memset(w->out, 0, sizeof w->out);
    for (int j = 0; j < N; j++)
        joint_law(j, w->phi[j + 1] - w->phi[j], w->om[j + 1] - w->om[j], w->z[j], pressure, w->out[j]);
    kinematics(w);
#if WITH_FORCE
    memset(w->force, 0, sizeof w->force);
    for (int j = 0; j < N; j++) body_force(CHAIN[j][LENGTH], w->motion[j], w->force[j]);
#endif
}

/* One Newton iteration of a stage; returns the largest change of an angle. */
static double newton(work_t *w, double sensed, double s) {
    double felt = sensed, right[N + 1], x[N + 1], largest = 0;
    double change = 0;
#if WITH_LINE
    felt -= VOLUME_RATE * (RESISTANCE * (w->om[N] - w->om[0]) + INERTANCE * (w->al[N] - w->al[0]));
#endif
    evaluate(w, felt);
    joint_factors(w, s, s, s * s);
    factor(w, 1, s, s * s);
    for (int i = 0; i <= N; i++) right[i] = w->body[i].residual;
    solve(w, right, x);
#if WITH_LINE
    {
        double by_p[N + 1];
        const double q = (RESISTANCE * s + INERTANCE) * VOLUME_RATE;
        for (int i = 1; i <= N; i++) right[i] = (i < N ? w->body[i + 1].tau_p : 0) - w->body[i].tau_p;
        right[0] = COMPLIANCE * w->body[1].tau_p;
        solve(w, right, by_p);
        change = -q * (x[N] - x[0]) / (1 + q * (by_p[N] - by_p[0]));
        for (int i = 0; i <= N; i++) x[i] += change * by_p[i];
    }
#endif
    for (int i = 0; i <= N; i++) {
        w->al[i] += x[i];
        w->om[i] += s * x[i];
        w->phi[i] += s * s * x[i];
        if (!(fabs(x[i]) * s * s <= largest)) largest = fabs(x[i]) * s * s; /* keeps what is not a number */
    }
#if M > 0
    for (int j = 0; j < N; j++)
        for (int r = 0; r < M; r++)
            w->z[j][r] += w->sx[j][r] * (x[j + 1] - x[j]) + w->zc[j][r] + w->zp[j][r] * change;
#else
    (void)change;
#endif
    return largest;
}

/* Static Newton at one pressure from the angles in `w`; 0 where it settles on a stable state. */
static int settle(work_t *w, double felt) {
    double right[N + 1], x[N + 1];
    for (int iteration = 0; iteration < 60; iteration++) {
#if M > 0
        double relaxed[N][STATES][2];
        memset(relaxed, 0, sizeof relaxed);
        for (int j = 0; j < N; j++) {
            relaxed_states(j, w->phi[j + 1] - w->phi[j], w->z[j], felt, relaxed[j]);
            for (int r = 0; r < M; r++) w->z[j][r] = relaxed[j][r][0];
        }
#endif
        evaluate(w, felt);
        for (int j = 0; j < N; j++) {
            w->body[j + 1].stiff = w->out[j][TAU_THETA];
            w->body[j + 1].z_torque = 0;
#if M > 0
            for (int r = 0; r < M; r++) w->body[j + 1].stiff += w->out[j][FIXED + r] * relaxed[j][r][1];
#endif
        }
        factor(w, 0, 0, 1);
        for (int i = 0; i <= N; i++) right[i] = w->body[i].residual;
        solve(w, right, x);
        double largest = fabs(x[0]);
        for (int i = 1; i <= N; i++)
            if (!(fabs(x[i] - x[i - 1]) <= largest)) largest = fabs(x[i] - x[i - 1]);
        if (!(largest < 1e6)) return 1;
        const double part = largest > 0.3 ? 0.3 / largest : 1;
        for (int i = 0; i <= N; i++) w->phi[i] += part * x[i];
        if (largest < 1e-12) {
            for (int i = 1; i <= N; i++)
                if (!(w->body[i].beta > 0) || fabs(w->phi[i] - w->phi[i - 1]) > 3) return 1;
            return 0;
        }
    }
    return 1;
}

static void observe(const @NAME@_t *model, @NAME@_output_t *output) {
    double hx = PIVOT * (1 - cos(model->phi[0])) - OUTER_RADIUS, hy = PIVOT * sin(model->phi[0]);
    for (int k = 1; k <= N; k++) {
        const double a = model->phi[k - 1], b = model->phi[k], half = POLYGON ? 0 : 0.5 * (b - a);
        const double middle = POLYGON ? b : 0.5 * (a + b);
        const double chord = ARC[k - 1] * (fabs(half) < 1e-4 ? 1 - half * half / 6 : sin(half) / half);
        hx -= chord * sin(middle);
        hy -= chord * cos(middle);
    }
    double shift = 0; /* of the centre line away from the inextensible side, as against the first cross-section's */
    line_shift(model->at_gauge, &shift);
    double longer = 0;
    stretch(model->at_gauge, &longer);
    hx = (1 + longer) * (hx + OUTER_RADIUS * cos(model->phi[N])) + shift * (cos(model->phi[N]) - cos(model->phi[0]));
    hy = (1 + longer) * (hy - OUTER_RADIUS * sin(model->phi[N])) + shift * (sin(model->phi[0]) - sin(model->phi[N]));
    output->tip_x_m = MIRROR * hx;
    output->tip_y_m = hy;
    output->angle_rad = model->phi[N];
    output->flow_m3_s = VOLUME_RATE * (model->rate[N] - model->rate[0]);
}

int @NAME@_init(@NAME@_t *model, double pressure_Pa, @NAME@_output_t *output) {
    work_t w;
    memset(&w, 0, sizeof w);
    memset(model, 0, sizeof *model);
    double target = 0;
    felt_pressure(pressure_Pa, &target);
    int failed = settle(&w, 0);
    for (int part = 1; part <= @STRIDES@ && !failed; part++) failed = settle(&w, target * part / @STRIDES@);
    memcpy(model->phi, w.phi, sizeof w.phi);
    memcpy(model->z, w.z, sizeof w.z);
    model->at_gauge = target;
    model->in_tube = target;
    if (output) observe(model, output);
    return failed;
}

int @NAME@_step(@NAME@_t *model, double pressure_Pa, @NAME@_output_t *output) {
    static const double GAMMA = 0.29289321881345254; /* 1 - sqrt(1/2) */
    double gauge = 0;
    felt_pressure(pressure_Pa, &gauge);
    const double s = GAMMA * STEP_S, slope = (gauge - model->at_gauge) / STEP_S;
    double first_rate[N + 1], first_al[N + 1], g[N][STATES];
    work_t w;
    memset(&w, 0, sizeof w);
    memcpy(w.al, model->acceleration, sizeof w.al);
    double in_tube = model->in_tube, change = 0, largest = 0;
    for (int stage = 0; stage < 2; stage++) {
        const double t = stage == 0 ? s : STEP_S, before = stage == 0 ? 0 : (1 - GAMMA) * STEP_S;
        in_tube = LAG_S < 1e-9 ? model->at_gauge + slope * t
                               : model->at_gauge + slope * (t - LAG_S)
                + (model->in_tube - model->at_gauge + slope * LAG_S) * exp(-t / (LAG_S < 1e-9 ? 1 : LAG_S));
        for (int i = 0; i <= N; i++) {
            w.om[i] = model->rate[i] + (stage ? before * first_al[i] : 0) + s * w.al[i];
            w.phi[i] = model->phi[i] + (stage ? before * first_rate[i] : 0) + s * w.om[i];
        }
        for (int j = 0; j < N; j++)
            for (int r = 0; r < M; r++)
                w.z[j][r] = w.z_star[j][r] = model->z[j][r] + (stage ? before * g[j][r] : 0);
        for (int iteration = 0; iteration < @NAME_UPPER@_NEWTON_ITERATIONS; iteration++) change = newton(&w, in_tube, s);
        if (!(change <= largest)) largest = change;
        memcpy(first_rate, w.om, sizeof first_rate);
        memcpy(first_al, w.al, sizeof first_al);
        for (int j = 0; j < N; j++)
            for (int r = 0; r < M; r++) g[j][r] = (w.z[j][r] - w.z_star[j][r]) / s;
    }
    memcpy(model->phi, w.phi, sizeof w.phi);
    memcpy(model->rate, w.om, sizeof w.om);
    memcpy(model->acceleration, w.al, sizeof w.al);
    memcpy(model->z, w.z, sizeof w.z);
    model->at_gauge = gauge;
    model->in_tube = in_tube;
    model->last_change = largest;
    if (output) observe(model, output);
    return !(largest < 1e-5);
}
