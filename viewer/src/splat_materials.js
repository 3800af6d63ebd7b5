import { AddEquation, CustomBlending, OneFactor, ShaderMaterial, Vector3 } from 'three';

import { kLargestRadius } from './surface_estimate.js';

// Surface splatting in two passes (Botsch and Kobbelt 2003): first the depth of all splats, moved back by a fraction of their
// radius, then the colours of those in front of it, blended by their distance to the splat's centre. `resolve_pass.js` divides.

const kVertexShader = /* glsl */ `
    attribute vec4 surface;        // normal; radius as a fraction of the largest
    #ifdef HAS_COLOR
    attribute vec4 color;          // sRGB
    #endif
    uniform float largestRadius;   // of this level, in units of the cloud
    uniform float pixelsPerUnit;   // at distance 1
    uniform float smallestPixels;
    uniform float largestPixels;
    uniform vec3 tint;             // linear, of clouds without colours
    uniform vec3 up;               // in view space
    varying vec3 splatNormal;
    varying float splatRadius;
    varying float splatDepth;
    varying vec3 splatColor;

    vec3 fromSrgb(vec3 c) {
        return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
    }

    // A key light over the left shoulder, a weak fill from the right, the sky from above.
    vec3 lit(vec3 albedo, vec3 n, vec3 toEye) {
        float key = max(0.0, dot(n, normalize(vec3(-0.5, 0.75, 0.62))));
        float fill = max(0.0, dot(n, normalize(vec3(0.85, -0.1, 0.45))));
        float sky = 0.5 + 0.5 * dot(n, up);
        float edge = pow(1.0 - max(0.0, dot(n, toEye)), 3.0);
    #ifdef HAS_COLOR
        vec3 light = vec3(0.70 + 0.36 * key + 0.10 * sky + 0.05 * fill);
        return albedo * light;
    #else
        vec3 light = vec3(1.0, 0.965, 0.91) * 0.86 * key + vec3(0.62, 0.74, 1.0) * 0.16 * fill
                   + mix(vec3(0.085, 0.075, 0.07), vec3(0.21, 0.235, 0.275), sky);
        vec3 halfway = normalize(normalize(vec3(-0.5, 0.75, 0.62)) + toEye);
        float gloss = 0.07 * pow(max(0.0, dot(n, halfway)), 28.0);
        return albedo * light + gloss + vec3(0.5, 0.6, 0.8) * 0.03 * edge;
    #endif
    }

    void main() {
        vec4 center = modelViewMatrix * vec4(position, 1.0);
        vec3 toEye = normalize(-center.xyz);
        vec3 n = normalMatrix * surface.xyz;
        bool oriented = dot(n, n) > 0.01;
        n = oriented ? normalize(n) : vec3(0.0);
        if (dot(n, toEye) < 0.0) {
            n = -n;  // scans turn their normals either way: the side that is seen is the outside
        }
    #ifdef HAS_COLOR
        vec3 albedo = fromSrgb(color.rgb);
    #else
        vec3 albedo = tint;
    #endif
        splatNormal = n;
        // Near the silhouette the side is a guess: there the light of both sides meets halfway.
        float certainty = smoothstep(0.0, 0.4, dot(n, toEye));
        vec3 front = lit(albedo, n, toEye);
        vec3 either = 0.5 * (front + lit(albedo, -n, toEye));
        splatColor = oriented ? mix(either, front, certainty) : albedo * 0.9;
        splatDepth = center.z;

        float scale = pixelsPerUnit / -center.z;
        float pixels = clamp(2.0 * surface.w * largestRadius * scale, smallestPixels, largestPixels);
        splatRadius = 0.5 * pixels / scale;
        gl_PointSize = pixels;
        gl_Position = projectionMatrix * center;
    }
`;

const kFragmentShader = /* glsl */ `
    uniform mat4 projectionMatrix;
    varying vec3 splatNormal;
    varying float splatRadius;
    varying float splatDepth;
    varying vec3 splatColor;

    void main() {
        // Where the ray through this pixel meets the splat's plane, in radii; seen edge-on a splat keeps a quarter of its width.
        vec2 p = vec2(2.0, -2.0) * (gl_PointCoord - 0.5);
        float slope = -dot(splatNormal.xy, p) / max(splatNormal.z, 0.25);
        float distanceSq = dot(p, p) + (splatNormal.z > 0.0 ? slope * slope : 0.0);
        if (distanceSq > 1.0) {
            discard;
        }
        float depth = splatDepth + slope * splatRadius;
    #ifdef DEPTH_PASS
        depth -= 0.6 * splatRadius;
        gl_FragColor = vec4(0.0);
    #else
        float weight = (1.0 - distanceSq) * (1.0 - distanceSq) + 1e-3;
        gl_FragColor = vec4(splatColor * weight, weight);
    #endif
        depth = min(depth, -1e-9);
        float clip = (projectionMatrix[2][2] * depth + projectionMatrix[3][2]) / -depth;
        gl_FragDepth = clamp(0.5 * clip + 0.5, 0.0, 1.0);
    }
`;

/** The two materials of the clouds with (or without) colours. They share their uniforms. */
export function splatMaterials({ colored }) {
    const uniforms = {
        largestRadius: { value: 1 },
        pixelsPerUnit: { value: 1 },
        smallestPixels: { value: 2 },
        largestPixels: { value: 256 },
        tint: { value: new Vector3(0.72, 0.68, 0.62) },
        up: { value: new Vector3(0, 1, 0) },
    };
    const common = { uniforms, vertexShader: kVertexShader, fragmentShader: kFragmentShader, depthTest: true };
    const color = colored ? { HAS_COLOR: 1 } : {};
    return {
        uniforms,
        depth: new ShaderMaterial({ ...common, defines: { ...color, DEPTH_PASS: 1 }, colorWrite: false }),
        blend: new ShaderMaterial({
            ...common,
            defines: color,
            depthWrite: false,
            transparent: true,
            blending: CustomBlending,
            blendEquation: AddEquation,
            blendSrc: OneFactor,
            blendDst: OneFactor,
        }),
    };
}

/** The radius that a full `surface.w` stands for; a lone point has no spacing and gets a size one can see. */
export const largestRadiusOf = (spacing, size) => kLargestRadius * (spacing > 0 ? spacing : 0.02 * size);
