// Elementary functions with the same bits on every machine. Code that decides a bit of a picture
// calls these, never those of libm. The bits of libm depend on its version and on the processor.
//
// Each is a fixed sequence of IEEE binary64 additions, multiplications, divisions and exact
// operations (rint, frexp, ldexp, fmod), without fused multiply-add. So results depend on the
// rounding mode (to nearest) alone.
//
// Errors are in units of the last place of the result, 1/2 being correct rounding. A result that a
// double can hold is exact: Cbrt(27), Pow(0.5, 2), Sin(0).

#ifndef ISOSCOPE_CORE_MATH_ELEMENTARY_H_
#define ISOSCOPE_CORE_MATH_ELEMENTARY_H_

namespace isoscope::math {

// At most 0.5000001 units off for |radians| <= 2^40; larger angles are first reduced modulo the
// double nearest 2 pi. Sin and Tan are odd, Cos is even, bit for bit. NaN for infinities and NaN.
// About 2 us.
double Sin(double radians);
double Cos(double radians);
double Tan(double radians);

// Returns x to the power of y, at most 0.5001 units off where the result is at least 2^-1000; below
// 2^-1022 it is rounded twice. Pow(x, 0) and Pow(1, y) are 1, Pow(0, y) is 0 for y > 0 and infinite
// for y < 0. NaN if x < 0. About 0.1 us. REQUIRES: x and y are finite.
double Pow(double x, double y);

// Returns the cube root, at most 0.5000001 units off where x is 0 or at least 2^-900. NaN if x < 0.
// REQUIRES: x is finite.
double Cbrt(double x);

}  // namespace isoscope::math

#endif  // ISOSCOPE_CORE_MATH_ELEMENTARY_H_
