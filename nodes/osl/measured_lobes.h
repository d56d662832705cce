// Twins of bake/lobes/cosine_lobes.py: cos^n and four cheaper curves, of u = 1 - cos and the exponent n > 0.

#ifndef MEASURED_LOBES_H
#define MEASURED_LOBES_H

#include "measured_materials.h"

// p, g and a of the cubic for n >= 1: cubic_coefficients
vector mm_cubic_coefficients(float n)
{
  float y = 0.5 * M_LN2 / n;
  float square = y * y;
  float odd = y * (square * (square * 21 + 1260) + 10395);
  float even = square * (square * (square + 210) + 4725) + 10395;
  float p = 2 * odd / (even + odd);
  float q = (even - odd) / (even + odd);
  float g = (q - 0.5) / q;
  return vector(p, g, (p + (g * (2 * q - 1) - 0.5 * (n * p) / q)) / q);
}

float mm_power_lobe(float u, float n)
{
  if (u >= 1)
    return 0;
  // OSL's pow() is fast and wrong by n times 1e-7: near the peak ln(1 - u) = -2 artanh(u / (2 - u)) by its series.
  if (u > 0.3)
    return pow(1 - u, n);
  float t = u / (2 - u);
  float s = t * t;
  float tail = s * (1.0 / 3 + s * (1.0 / 5 + s * (1.0 / 7 + s * (1.0 / 9 + s * (1.0 / 11)))));
  return exp(-2 * n * t * (1 + tail));
}

float mm_cosine_power_lobe(float u, float n)
{
  float x = sqrt(0.5 * min(u, 1.0));
  float s = x * x;
  // OSL's arcsine keeps no digits of small angles, not even with the Newton step: there its series.
  float half = x < 0.1 ? x * (1 + s * (1.0 / 6 + s * (3.0 / 40 + s * (5.0 / 112)))) : mm_arcsin(x);
  float factor = cos(min(2 * half * sqrt(0.25 * n), M_PI_2));
  return u < 1 ? factor * factor * factor * factor : 0;
}

float mm_cubic_lobe(float u, float n)
{
  if (n < 1)
    return mm_power_lobe(u, n);
  vector k = mm_cubic_coefficients(n);
  if (u < k[0]) {
    float s = u / k[0];
    return (1 - u) * (1 - s * (k[1] + k[2] * (1 - s)));
  }
  float c = max(1 - u, 0.0);
  return c / (2 * n * (u - k[0]) + 2 * c);
}

// cosine_lobe
float mm_cosine_lobe(string name, float u, float n)
{
  if (name == "power")
    return mm_power_lobe(u, n);
  if (name == "cubic")
    return mm_cubic_lobe(u, n);
  if (name == "cosine")
    return mm_cosine_power_lobe(u, n);
  float c = max(1 - u, 0.0);
  if (name == "schlick")
    return c / (n * u + c);
  float factor = max(1 - 0.25 * n * u, 0.0);
  return u < 1 ? factor * factor * factor * factor : 0;
}

// Integral of lobe times 1 - u over u from 0 to `upper`, by Gauss-Legendre; of "cosine" over the angle instead.
float mm_lobe_quadrature(string name, float n, float upper)
{
  float at[8] = {0.0198550718, 0.101666761, 0.237233795, 0.408282679,
                 0.591717321, 0.762766205, 0.898333239, 0.980144928};
  float weight[4] = {0.0506142681, 0.111190517, 0.156853323, 0.181341892};
  float total = 0;
  for (int k = 0; k < 8; ++k) {
    float x = at[k] * upper;
    float value = 0;
    if (name == "cosine") {
      float factor = cos(x * sqrt(0.25 * n));
      value = factor * factor * factor * factor * sin(2 * x) * 0.5;
    }
    else
      value = mm_cosine_lobe(name, x, n) * (1 - x);
    total += weight[k < 4 ? k : 7 - k] * value;
  }
  return total * upper;
}

float mm_schlick_integral(float n)
{
  if (n > 0.5 && n < 2)
    return mm_lobe_quadrature("schlick", n, 1.0);
  float m = n - 1;
  return (n * (n * log(n) / m - 1) / m - 0.5) / m;
}

// lobe_norm, in 1/sr
float mm_lobe_norm(string name, float n)
{
  float integral = 1 / (n + 2);
  if (name == "schlick")
    integral = mm_schlick_integral(n);
  else if (name == "lyon")
    integral = mm_lobe_quadrature(name, n, min(4 / n, 1.0));
  else if (name == "cosine")
    integral = mm_lobe_quadrature(name, n, M_PI_2 / max(sqrt(0.25 * n), 1.0));
  else if (name == "cubic" && n >= 1) {
    vector k = mm_cubic_coefficients(n);
    // Of the cubic itself a polynomial of degree 4, which the nodes integrate exactly.
    float q = 1 - k[0];
    integral = mm_lobe_quadrature(name, n, k[0]) + 0.5 * q * q * mm_schlick_integral(n);
  }
  return 0.5 / (M_PI * integral);
}

#endif
