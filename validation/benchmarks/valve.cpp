// The impacting relief valve as a loop in C++, written for this comparison, after the published
// example of MPGOS: pairs of Cash and Karp 4(5), events by secants on the length of a step.

#include <algorithm>
#include <array>
#include <cmath>

namespace {

constexpr int N = 3;
constexpr double kappa = 1.25, beta = 20.0, delta = 10.0, restitution = 0.8;
using State = std::array<double, N>;

State flow(const State& y, double q) {
    return {y[1], -kappa * y[1] - (y[0] + delta) + y[2], beta * (q - y[0] * std::sqrt(y[2]))};
}

// A step of length h; the largest error in units of the tolerance.
double step(const State& y, double q, double h, double rtol, double atol, State& next) {
    static constexpr double a[6][5] = {
        {},
        {1.0 / 5},
        {3.0 / 40, 9.0 / 40},
        {3.0 / 10, -9.0 / 10, 6.0 / 5},
        {-11.0 / 54, 5.0 / 2, -70.0 / 27, 35.0 / 27},
        {1631.0 / 55296, 175.0 / 512, 575.0 / 13824, 44275.0 / 110592, 253.0 / 4096}};
    static constexpr double fifth[6] = {37.0 / 378, 0, 250.0 / 621, 125.0 / 594, 0, 512.0 / 1771};
    static constexpr double fourth[6] = {2825.0 / 27648, 0, 18575.0 / 48384,
                                         13525.0 / 55296, 277.0 / 14336, 1.0 / 4};
    State k[6];
    for (int s = 0; s < 6; s++) {
        State stage = y;
        for (int r = 0; r < s; r++)
            for (int i = 0; i < N; i++) stage[i] += h * a[s][r] * k[r][i];
        k[s] = flow(stage, q);
    }
    double worst = 0.0;
    for (int i = 0; i < N; i++) {
        double sum = 0.0, error = 0.0;
        for (int s = 0; s < 6; s++) {
            sum += fifth[s] * k[s][i];
            error += (fifth[s] - fourth[s]) * k[s][i];
        }
        next[i] = y[i] + h * sum;
        const double scale = atol + rtol * std::max(std::abs(y[i]), std::abs(next[i]));
        worst = std::max(worst, std::abs(h * error) / scale);
    }
    return std::isfinite(worst) ? worst : 1e10;
}

// The length of a step to where component i vanishes, by regula falsi (Illinois); its end is next.
double length_to_zero(const State& y, double q, double h, int i, double within, State& next) {
    double low = 0.0, high = h, below = y[i], above = next[i], length = h;
    for (int n = 0; n < 60; n++) {
        length = (low * above - high * below) / (above - below);
        step(y, q, length, 1.0, 1.0, next);
        if (std::abs(next[i]) < within) break;
        if ((next[i] > 0.0) == (above > 0.0)) {
            high = length, above = next[i], below *= 0.5;
        } else {
            low = length, below = next[i], above *= 0.5;
        }
    }
    return length;
}

}  // namespace

// Integrate y from 0 to end; the number of local maxima of the position. The last one is stored.
extern "C" long integrate(double q, double end, double tolerance, double* state, double* maximum) {
    const double rtol = tolerance, atol = 0.01 * tolerance, within = tolerance;
    State y = {state[0], state[1], state[2]}, next;
    long maxima = 0;
    double t = 0.0, h = 1e-3;
    while (t < end) {
        h = std::min(h, end - t);
        const double error = step(y, q, h, rtol, atol, next);
        const double factor = std::clamp(0.9 * std::pow(error + 1e-12, -0.2), 0.2, 5.0);
        if (error > 1.0) {
            h *= factor;
            continue;
        }
        double length = h;
        const bool turns = y[1] > within && next[1] < -within;
        if (turns) length = length_to_zero(y, q, h, 1, within, next);
        const bool hits = y[0] > within && next[0] < -within;
        if (hits) length = length_to_zero(y, q, length, 0, within, next);
        t += length;
        y = next;
        if (hits) {
            y = {0.0, -restitution * y[1], y[2]};
        } else if (turns) {
            maxima++;
            *maximum = y[0];
            y[1] = 0.0;
        }
        h = hits ? h : h * factor;
    }
    std::copy(y.begin(), y.end(), state);
    return maxima;
}
