import { AddEquation, CustomBlending, OneFactor, ShaderMaterial, Vector3 } from 'three';

import { kLargestRadius } from '../loading/surface_estimate.js';

// Surface splatting in two passes (Botsch and Kobbelt 2003): first the depth of all splats, moved back by a fraction of their
// radius, then the colours of those in front of it, blended by their distance to the splat's centre. `resolve_pass.js` divides.

const kVertexShader = /* glsl */ `
    attribute vec4 surface;        // normal, shorter where it is in doubt; radius as a fraction of the largest
    #ifdef HAS_COLOR
    attribute vec4 color;          // sRGB
    #endif
    #ifdef ELLIPTIC
    attribute vec3 major;          // half axes, in units of the cloud: the major one is the radius
    attribute vec3 minor;
    varying vec3 splatMajor;       // what a place in the splat's plane, in radii, is multiplied by to tell how far out it is
    varying vec3 splatMinor;
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
    varying float splatSoftness;   // how far behind the front others still blend with it, in radii
    varying float splatBulge;      // how far its middle stands before its rim, in radii
    varying vec3 splatColor;

    const float kSoftness = 0.8;
    const float kSoftnessOfBalls = 1.2;

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
        float trust = clamp(length(surface.xyz), 0.0, 1.0);
        bool oriented = trust > 0.01;
        vec3 n = oriented ? normalize(normalMatrix * surface.xyz) : vec3(0.0);
        if (dot(n, toEye) < 0.0) {
            n = -n;  // scans turn their normals either way: the side that is seen is the outside
        }
    #ifdef HAS_COLOR
        vec3 albedo = fromSrgb(color.rgb);
    #else
        vec3 albedo = tint;
    #endif
    #ifdef ELLIPTIC
        splatNormal = n;
        splatSoftness = kSoftness;
        splatBulge = 0.0;
    #else
        // A splat that cannot know its plane faces the viewer, as a ball would.
        splatNormal = normalize(mix(toEye, n, oriented ? trust : 0.0));
        splatSoftness = mix(kSoftnessOfBalls, kSoftness, trust);
        splatBulge = 1.0 - trust;
    #endif
        // Near the silhouette the side is a guess, and in leaves the normal is: there the light of both sides meets halfway.
        float certainty = smoothstep(0.0, 0.4, dot(n, toEye)) * mix(0.4, 1.0, trust);
        vec3 front = lit(albedo, n, toEye);
        vec3 either = 0.5 * (front + lit(albedo, -n, toEye));
        splatColor = oriented ? mix(either, front, certainty) : albedo * 0.9;
        splatDepth = center.z;

        float scale = pixelsPerUnit / -center.z;
    #ifdef ELLIPTIC
        float radius = length(major) * largestRadius;
    #else
        float radius = surface.w * largestRadius;
    #endif
        float pixels = clamp(2.0 * radius * scale, smallestPixels, largestPixels);
    #ifdef ELLIPTIC
        // No thinner than a splat may be small.
        float thinness = clamp(length(major) / max(length(minor), 1e-30), 1.0, pixels / smallestPixels);
        splatMajor = normalMatrix * (major / max(length(major), 1e-30));
        splatMinor = normalMatrix * (minor / max(length(minor), 1e-30)) * thinness;
    #endif
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
    varying float splatSoftness;
    varying float splatBulge;
    varying vec3 splatColor;
    #ifdef ELLIPTIC
    varying vec3 splatMajor;
    varying vec3 splatMinor;
    #endif

    void main() {
        // Where the ray through this pixel meets the splat's plane, in radii; seen edge-on a splat keeps a quarter of its width.
        vec2 p = vec2(2.0, -2.0) * (gl_PointCoord - 0.5);
        float slope = -dot(splatNormal.xy, p) / max(splatNormal.z, 0.25);
        vec3 place = vec3(p, slope);
    #ifdef ELLIPTIC
        vec3 reach = vec3(dot(place, splatMajor), dot(place, splatMinor), dot(place, splatNormal));
        float distanceSq = dot(reach, reach);
    #else
        float distanceSq = dot(place, place);
    #endif
        if (distanceSq > 1.0) {
            discard;
        }
        float depth = splatDepth + slope * splatRadius;
    #ifndef ELLIPTIC
        depth += splatBulge * sqrt(max(0.0, 1.0 - dot(p, p))) * splatRadius;
    #endif
    #ifdef DEPTH_PASS
        depth -= splatSoftness * splatRadius;
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

/** The materials of all kinds of clouds. They share their uniforms. */
export class SplatMaterials {
    constructor() {
        this.uniforms = {
            largestRadius: { value: 1 },
            pixelsPerUnit: { value: 1 },
            smallestPixels: { value: 2 },
            largestPixels: { value: 256 },
            tint: { value: new Vector3(0.72, 0.68, 0.62) },
            up: { value: new Vector3(0, 1, 0) },
        };
        this.made = new Map();
    }

    /** Those of the two passes, for clouds with or without colours, whose splats are round or elliptic. */
    of({ colored, elliptic }) {
        const defines = { ...(colored ? { HAS_COLOR: 1 } : {}), ...(elliptic ? { ELLIPTIC: 1 } : {}) };
        const key = Object.keys(defines).join();
        if (!this.made.has(key)) {
            this.made.set(key, this.make(defines));
        }
        return this.made.get(key);
    }

    make(defines) {
        const common = { uniforms: this.uniforms, vertexShader: kVertexShader, fragmentShader: kFragmentShader, depthTest: true };
        return {
            depth: new ShaderMaterial({ ...common, defines: { ...defines, DEPTH_PASS: 1 }, colorWrite: false }),
            blend: new ShaderMaterial({
                ...common,
                defines,
                depthWrite: false,
                transparent: true,
                blending: CustomBlending,
                blendEquation: AddEquation,
                blendSrc: OneFactor,
                blendDst: OneFactor,
            }),
        };
    }
}

/** How much larger than measured ellipses are drawn: those just meet, and what overlaps blends. */
export const kEllipseOverlap = 1.4;

/** The radius that a full `surface.w` stands for; a lone point has no spacing and gets a size one can see. */
export const largestRadiusOf = (spacing, size) => kLargestRadius * (spacing > 0 ? spacing : 0.02 * size);
