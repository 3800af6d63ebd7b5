import {
    DepthTexture, FloatType, GLSL3, HalfFloatType, LinearSRGBColorSpace, MathUtils, Mesh, NearestFilter, NoBlending, OrthographicCamera,
    PlaneGeometry, RGBAFormat, Scene, ShaderMaterial, Vector2, WebGLRenderTarget,
} from 'three';

const kFragmentShader = /* glsl */ `
    precision highp float;
    uniform sampler2D sums;        // colour × weight, weight
    uniform sampler2D depths;
    uniform vec2 texel;            // of the sums
    uniform int samples;           // per pixel and axis
    uniform vec2 corner;           // of the picture, in pixels of the canvas
    uniform float reach;           // of the shading, in texels
    uniform float near, far;
    uniform float strength;
    uniform float stepHeight;      // up to which it draws no line, in units of the cloud
    uniform float texelSize;       // in units of the cloud, at distance 1
    out vec4 result;

    const int kAround = 8;
    const float kPerLog = 0.693147;  // of the distance, a change of its logarithm
    const float kMostTilt = 5.0;     // near a silhouette a step may be one to what is behind

    float logDistance(vec2 at) {
        float z = 2.0 * texture(depths, at).r - 1.0;
        return log2(2.0 * near * far / (far + near - z * (far - near)));
    }

    vec2 towards(int i) {
        float angle = 0.785398 * float(i);
        return vec2(cos(angle), sin(angle)) * texel * reach;
    }

    // How much higher a step is along the view than across the surface. A slope goes on to the other side, as an edge does not.
    float tilt(float ring[kAround]) {
        vec4 slopes;
        for (int i = 0; i < 4; i++) {
            slopes[i] = min(abs(ring[i]), abs(ring[i + 4])) * kPerLog / (reach * texelSize);
        }
        vec4 squares = slopes * slopes;
        return min(kMostTilt, sqrt(1.0 + max(squares.x + squares.z, squares.y + squares.w)));
    }

    // Eye-dome lighting (Boucheny 2009): what lies behind its surroundings is darker. Two rings: lines and hollows.
    float shade(vec2 at) {
        float own = logDistance(at);
        float ring[kAround];
        float sum = 0.0;
        for (int i = 0; i < kAround; i++) {
            ring[i] = own - logDistance(at + towards(i));
        }
        float rise = stepHeight * tilt(ring) / (exp2(own) * kPerLog);
        for (int i = 0; i < kAround; i++) {
            sum += clamp(ring[i] - rise, 0.0, 0.008);
            sum += 0.3 * clamp(own - logDistance(at + 5.0 * towards(i)) - rise, 0.0, 0.025);
        }
        return max(0.4, exp(-strength * sum));
    }

    vec3 toSrgb(vec3 c) {
        return mix(c * 12.92, 1.055 * pow(max(c, 0.0), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
    }

    void main() {
        vec4 sum = vec4(0.0);
        vec2 first = (floor(gl_FragCoord.xy - corner) * float(samples) + 0.5) * texel;
        for (int y = 0; y < samples; y++) {
            for (int x = 0; x < samples; x++) {
                vec2 at = first + vec2(x, y) * texel;
                vec4 splats = texture(sums, at);
                if (splats.a > 0.0) {
                    sum += vec4(splats.rgb / splats.a * shade(at), 1.0);
                }
            }
        }
        sum /= float(samples * samples);
        // Premultiplied, over the page's own background.
        result = vec4(sum.a > 0.0 ? toSrgb(min(sum.rgb / sum.a, 1.0)) * sum.a : vec3(0.0), sum.a);
    }
`;

const kShading = 12;

/** Turns the sums of the splats into the picture: normalised colours, eye-dome lighting, smooth edges. */
export class ResolvePass {
    constructor() {
        this.target = new WebGLRenderTarget(1, 1, {
            type: HalfFloatType,
            format: RGBAFormat,
            colorSpace: LinearSRGBColorSpace,
            minFilter: NearestFilter,
            magFilter: NearestFilter,
            depthTexture: new DepthTexture(1, 1, FloatType),
        });
        this.uniforms = {
            sums: { value: this.target.texture },
            depths: { value: this.target.depthTexture },
            texel: { value: new Vector2() },
            samples: { value: 1 },
            corner: { value: new Vector2() },
            reach: { value: 1 },
            near: { value: 1 },
            far: { value: 2 },
            strength: { value: kShading },
            stepHeight: { value: 0 },
            texelSize: { value: 1 },
        };
        this.scene = new Scene();
        this.camera = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
        const material = new ShaderMaterial({
            glslVersion: GLSL3,
            uniforms: this.uniforms,
            vertexShader: 'void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }',
            fragmentShader: kFragmentShader,
            blending: NoBlending,
            depthTest: false,
            depthWrite: false,
        });
        this.scene.add(new Mesh(new PlaneGeometry(2, 2), material));
        this.scene.children[0].frustumCulled = false;
    }

    /** @param samples  of the target per pixel of the picture and axis */
    setSize(width, height, samples) {
        this.target.setSize(width * samples, height * samples);
        this.uniforms.texel.value.set(1 / (width * samples), 1 / (height * samples));
        this.uniforms.samples.value = samples;
    }

    /**
     * @param reach  of the shading, in samples; @param shading  how strong, 1: as designed; @param stepHeight  up to which it draws no line, in
     * units of the cloud: splats of one surface lie in steps
     */
    render(renderer, camera, { view, ratio, reach, shading, stepHeight }) {
        const { left, width, height, clip } = view;
        this.uniforms.near.value = camera.near;
        this.uniforms.far.value = camera.far;
        this.uniforms.reach.value = reach;
        this.uniforms.strength.value = kShading * shading;
        this.uniforms.stepHeight.value = stepHeight;
        this.uniforms.texelSize.value = 2 * Math.tan(MathUtils.degToRad(camera.fov / 2)) / this.target.height;
        this.uniforms.corner.value.set(Math.round(left * ratio), 0);
        renderer.setRenderTarget(null);
        renderer.setViewport(left, 0, width, height);
        renderer.setScissor(clip.left, 0, clip.right - clip.left, height);
        renderer.setScissorTest(true);
        renderer.render(this.scene, this.camera);
    }
}
