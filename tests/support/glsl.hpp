// glsl.hpp: the part of GLSL that shading formulas need, so that C++ compiles and tests them.
// Threads: pure functions, [any].
#ifndef LW_TESTS_SUPPORT_GLSL_HPP
#define LW_TESTS_SUPPORT_GLSL_HPP

#include <algorithm>
#include <cmath>

namespace glsl {

using std::exp;
using std::sqrt;

struct vec2 {
    double x = 0, y = 0;
    vec2() = default;
    explicit vec2(double v) : x(v), y(v) {}
    vec2(double first, double second) : x(first), y(second) {}
};

struct vec3 {
    double x = 0, y = 0, z = 0;
    vec3() = default;
    explicit vec3(double v) : x(v), y(v), z(v) {}
    vec3(double first, double second, double third) : x(first), y(second), z(third) {}
};

inline vec2 operator+(vec2 a, vec2 b) { return {a.x + b.x, a.y + b.y}; }
inline vec2 operator+(double a, vec2 b) { return vec2(a) + b; }
inline vec2 operator*(double a, vec2 b) { return {a * b.x, a * b.y}; }

inline vec3 operator+(vec3 a, vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline vec3 operator*(double a, vec3 b) { return {a * b.x, a * b.y, a * b.z}; }
inline vec3 operator*(vec3 a, double b) { return b * a; }
inline vec3 operator/(vec3 a, double b) { return {a.x / b, a.y / b, a.z / b}; }
inline vec3 operator-(vec3 a, vec3 b) { return a + -1 * b; }
inline vec3 operator-(vec3 a, double b) { return a - vec3(b); }
inline vec3 &operator*=(vec3 &a, double b) { return a = b * a; }
inline bool operator==(vec3 a, vec3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

inline double min(double a, double b) { return std::min(a, b); }
inline double max(double a, double b) { return std::max(a, b); }
inline vec2 max(vec2 a, double b) { return {std::max(a.x, b), std::max(a.y, b)}; }
inline double clamp(double x, double low, double high) { return std::min(std::max(x, low), high); }
inline vec2 clamp(vec2 v, vec2 low, vec2 high) {
    return {clamp(v.x, low.x, high.x), clamp(v.y, low.y, high.y)};
}
inline double inversesqrt(double x) { return 1 / std::sqrt(x); }
inline double dot(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline double length(vec3 v) { return std::sqrt(dot(v, v)); }
inline vec3 normalize(vec3 v) { return v / length(v); }

} // namespace glsl

#endif
