// Pieces that several shaders share. Colours are what the screen takes: nothing is converted.

/** A line between two places as a strip of pixels, soft at its edges: no need for costly smoothing of the whole picture. */
export const STRIP = /* glsl */ `
uniform vec2 uSize;
varying float vAcross;
varying float vHalf;

/** corner: x 0 at the beginning, 1 at the end; y -1 to 1 across. */
vec4 strip(vec3 start, vec3 end, vec2 corner, float width_px) {
  vec4 a = viewMatrix * vec4(start, 1.0);
  vec4 b = viewMatrix * vec4(end, 1.0);
  float near = -1.001 * projectionMatrix[3][2] / (projectionMatrix[2][2] - 1.0);
  if (a.z > near && b.z > near) return vec4(0.0, 0.0, 2.0, 1.0);
  if (a.z > near) a = mix(a, b, (near - a.z) / (b.z - a.z));
  if (b.z > near) b = mix(b, a, (near - b.z) / (a.z - b.z));
  vec4 p = projectionMatrix * a;
  vec4 q = projectionMatrix * b;
  vec2 along = (q.xy / q.w - p.xy / p.w) * uSize;
  float far = length(along);
  along = far > 1e-4 ? along / far : vec2(1.0, 0.0);
  vHalf = 0.5 * width_px + 0.6;
  vAcross = corner.y * vHalf;
  vec4 at = corner.x < 0.5 ? p : q;
  vec2 off = vec2(-along.y, along.x) * vAcross;
  at.xy += 2.0 * off / uSize * at.w;
  return at;
}`;

export const STRIP_EDGE = /* glsl */ `
varying float vAcross;
varying float vHalf;
float edge() { return clamp(vHalf + 0.1 - abs(vAcross), 0.0, 1.0); }`;
