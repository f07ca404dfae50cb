/* Arithmetic of Python in C. */

#ifndef ARITHMETIC_H
#define ARITHMETIC_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

/* The event loop relies on exact zeros of differences, which fused operations do not preserve. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize ("fp-contract=off")
#else
#pragma STDC FP_CONTRACT OFF
#endif

#ifndef M_PI
#define M_PI 3.14159265358979323846
#endif

/* min and max of Python: the first of two equal values, and of two that do not compare */
static inline double least(double a, double b) { return b < a ? b : a; }
static inline double most(double a, double b) { return b > a ? b : a; }
static inline int64_t least_i(int64_t a, int64_t b) { return b < a ? b : a; }
static inline int64_t most_i(int64_t a, int64_t b) { return b > a ? b : a; }

/* minimum and maximum of NumPy: nan if either is */
static inline double lesser(double a, double b) { return a < b || isnan(a) ? a : b; }
static inline double greater(double a, double b) { return a > b || isnan(a) ? a : b; }

static inline double sign_of(double x) { return isnan(x) ? x : (double)((x > 0.0) - (x < 0.0)); }
static inline double heaviside(double x, double h)
{ return isnan(x) ? x : (x < 0.0 ? 0.0 : (x > 0.0 ? 1.0 : h)); }
static inline double scaled(double x, int64_t n)
{ return ldexp(x, n > 5000 ? 5000 : (n < -5000 ? -5000 : (int)n)); }
static inline double square(double x) { return x * x; }
static inline double to_degrees(double x) { return x * (180.0 / M_PI); }
static inline double to_radians(double x) { return x * (M_PI / 180.0); }

/* Integers have 64 bits: where Python's are larger or raise an exception, a fault is recorded. */
static bool integer_fault;
static inline int64_t faulty(void) { integer_fault = true; return 0; }
static inline bool take_integer_fault(void)
{ bool fault = integer_fault; integer_fault = false; return fault; }
static inline int64_t sum_i(int64_t a, int64_t b)
{ return (b > 0 ? a > INT64_MAX - b : a < INT64_MIN - b) ? faulty() : a + b; }
static inline int64_t difference_i(int64_t a, int64_t b)
{ return (b < 0 ? a > INT64_MAX + b : a < INT64_MIN + b) ? faulty() : a - b; }
static inline int64_t product_i(int64_t a, int64_t b)
{
    if (a == 0 || b == 0) return 0;
    if (a == -1) return difference_i(0, b);
    if (b == -1) return difference_i(0, a);
    if ((a > 0) == (b > 0) ? (a > 0 ? a > INT64_MAX / b : a < INT64_MAX / b)
                           : (a > 0 ? b < INT64_MIN / a : a < INT64_MIN / b)) return faulty();
    return a * b;
}
static inline int64_t left_i(int64_t a, int64_t b)
{ return b < 0 || (b > 62 && a != 0) ? faulty() : (a == 0 ? 0 : product_i(a, INT64_C(1) << b)); }
static inline int64_t right_i(int64_t a, int64_t b)
{ return b < 0 ? faulty() : (b > 63 ? (a < 0 ? -1 : 0) : a >> b); }
static inline int64_t integer_of(double x)
{ return x >= -9223372036854775808.0 && x < 9223372036854775808.0 ? (int64_t)x : faulty(); }
static inline double exact_real(int64_t a)
{
    if (a > (INT64_C(1) << 53) || a < -(INT64_C(1) << 53)) (void)faulty();
    return (double)a;
}
static inline int64_t integer_abs(int64_t a) { return a < 0 ? difference_i(0, a) : a; }
static inline int64_t wrapped(int64_t i, int64_t length) { return i < 0 ? i + length : i; }

static inline double floor_modulo(double a, double b)
{
    double r = fmod(a, b);
    if (r != 0.0) return ((b < 0.0) != (r < 0.0)) ? r + b : r;
    return copysign(0.0, b);
}

static inline double floor_divide(double a, double b)
{
    double q;
    if (b == 0.0) return a / b;
    q = (a - floor_modulo(a, b)) / b;
    return q == 0.0 ? copysign(0.0, a / b) : (q - floor(q) > 0.5 ? floor(q) + 1.0 : floor(q));
}

static inline int64_t floor_divide_i(int64_t a, int64_t b)
{
    int64_t q;
    if (b == 0) return faulty();
    if (b == -1) return difference_i(0, a);
    q = a / b;
    return (a % b != 0 && (a < 0) != (b < 0)) ? q - 1 : q;
}

static inline int64_t floor_modulo_i(int64_t a, int64_t b)
{
    int64_t r;
    if (b == 0) return faulty();
    if (b == -1) return 0;
    r = a % b;
    return (r != 0 && (r < 0) != (b < 0)) ? r + b : r;
}

static inline double integer_power(double x, int64_t n)
{
    double result = 1.0;
    while (n > 0) {
        if (n & 1) result *= x;
        n >>= 1;
        if (n > 0) x *= x;
    }
    return result;
}

static inline int64_t integer_power_i(int64_t x, int64_t n)
{
    int64_t result = 1;
    if (n < 0) return x == 1 ? 1 : (x == -1 ? ((n & 1) ? -1 : 1) : 0);
    while (n > 0) {
        if (n & 1) result = product_i(result, x);
        n >>= 1;
        if (n > 0) x = product_i(x, x);
    }
    return result;
}

#endif
