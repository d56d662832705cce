// A change of gloss: twin of bake/sampling/gloss.py and nodes/gloss_group.py (addon/docs/method.md, section 9).

#ifndef MEASURED_GLOSS_H
#define MEASURED_GLOSS_H

#define MM_LEAST_GLOSS 0.25
#define MM_MOST_GLOSS 4.0

// stretched: the direction whose half vector has slopes `gloss` times those of wi, and the factor of its density.
// Directions in any frame in which n is the normal; exactly wi and 1 at a gloss of 1.
vector mm_stretched(vector wi, vector wo, vector n, float gloss, output float spread)
{
  spread = 1;
  if (gloss == 1)
    return wi;
  vector total = wi + wo;
  vector half_vector = total + (gloss - 1) * (total - n * dot(n, total));
  float facing = dot(wo, half_vector);
  float square = dot(half_vector, half_vector);
  float tilt = gloss * length(total) / square;
  spread = max(2 * facing, 0.0) * tilt * tilt;
  return half_vector * (2 * facing / square) - wo;
}

// seen_from_table: where a local direction of the table is seen, and the factor of a density there.
vector mm_seen(vector wi, vector wo, float gloss, output float spread)
{
  float back;
  vector seen = mm_stretched(wi, wo, vector(0, 0, 1), 1 / gloss, back);
  spread = 1 / back;
  return seen;
}

// seen_in_table: the direction of the table that is seen along a local one, and the factor of a density.
vector mm_in_table(vector wi, vector wo, float gloss, output float spread)
{
  return mm_stretched(wi, wo, vector(0, 0, 1), gloss, spread);
}

// held
float mm_held_gloss(float gloss)
{
  return clamp(gloss, MM_LEAST_GLOSS, MM_MOST_GLOSS);
}

#endif
