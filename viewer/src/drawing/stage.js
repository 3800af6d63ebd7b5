import { Box3, BufferAttribute, BufferGeometry, MathUtils, PerspectiveCamera, Points, Sphere, Vector3, WebGLRenderer } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

import { Pane } from './pane.js';
import { kEllipseOverlap, largestRadiusOf, SplatMaterials } from './splat_materials.js';

const kFieldOfView = 32;
const kFewPoints = 1000;
const kMargin = 1.17;          // around a fitted cloud
const kFittedPoints = 20_000;  // enough to know how large a cloud is
const kFittedShare = 0.995;
const kNotable = 1.02;         // of the distance from a cloud
const kGlideMs = 650;
const kLeftPerSecond = 0.0035;  // of the speed that a drag leaves, however many frames there are
const kRestMs = 140;           // without a change: draw once more, finer
const kPickPixels = 14;
const kTurnsPerSecond = 1 / 40;
const kViewDigits = 6;
const kApart = 100;            // reaches of a cloud: another farther off has no coordinates in common with it
const kAskedForMost = 1000;    // points that tell where most are
const kFewShare = 0.05;        // of them at either end of an axis, ...
const kFarOff = 3;             // ... where the whole is so many times as long as without them
const kAround = 0.1;           // of the side of most: what is likely to be theirs, too
const kNearest = 2e-3;         // radii of a cloud from the camera to what it turns around, ...
const kFarthest = 100;         // ... where the cloud is a dot
const kClose = 0.6;            // radii of a cloud to a place of it that is looked at
const kLongestFrameS = 1;      // of rotation: a page that was hidden does not jump far
const kMostSamples = 36e6;     // of pictures at rest, 12 bytes each
const kSlack = 1.05;           // of the size of a cloud, for its splats
const kStill = 3e-5;           // of its distance, what the camera may move in a picture at rest

const kContext = { alpha: true, antialias: false, powerPreference: 'high-performance' };

/** Whether the browser can. What was made to find out is used then. */
export const canDrawOn = (canvas) => canvas.getContext('webgl2', kContext) !== null;

/**
 * The canvas: one cloud, or two with one camera, either side of a line; pictures only when something has changed.
 * `panes` show the clouds; the first one places the camera.
 */
export class Stage {
    /** @param onMoved  told that it is looked at from elsewhere; @param onPoint  which point is looked at closely, see `focusAt` */
    constructor(canvas, { onPicture, onMoved, onPoint }) {
        Object.assign(this, { onMoved, onPoint });
        this.canvas = canvas;
        this.renderer = new WebGLRenderer({ canvas, ...kContext });
        this.renderer.autoClear = false;
        this.renderer.debug.checkShaderErrors = false;  // asking for them waits for the compiler
        this.camera = new PerspectiveCamera(kFieldOfView, 1, 0.1, 10);
        this.autoRotate = false;
        this.glide = null;
        this.isAtHome = false;  // looks from where a cloud is shown first, and was not moved
        this.startView = null;  // from where the next cloud is looked at first, or null: from home
        this.renewControls();
        this.materials = new SplatMaterials();
        this.panes = [new Pane(this, onPicture), new Pane(this, () => {})];
        this.split = { mode: 'one', at: 0.5 };
        this.look = { splatSize: 1, shading: 1 };
        this.insets = { left: 0, right: 0, top: 0, bottom: 0 };
        this.warmUp({ colored: false });
        this.largestPointSize = this.renderer.getContext().getParameter(
            this.renderer.getContext().ALIASED_POINT_SIZE_RANGE)[1];
        this.dirty = true;
        this.changedAt = 0;
        this.frameAt = 0;
        this.seen = { position: new Vector3(), target: new Vector3() };  // in the last picture
        this.resting = false;
        new ResizeObserver(() => this.changed()).observe(canvas);
        canvas.addEventListener('dblclick', (event) => this.focusAt(event.offsetX, event.offsetY));
        canvas.addEventListener('webglcontextrestored', () => this.changed());
        this.watchDensity();
        this.renderer.setAnimationLoop((now) => this.frame(now));
    }

    /** Of pixels: another where the window is moved to another screen, at the same size. */
    watchDensity() {
        matchMedia(`(resolution: ${devicePixelRatio}dppx)`).addEventListener('change', () => {
            this.changed();
            this.watchDensity();
        }, { once: true });
    }

    /** Has the shaders of clouds with (or without) colours compiled before one is shown: that takes longer than its first level. */
    warmUp({ colored }) {
        const geometry = new BufferGeometry().setAttribute('position', new BufferAttribute(new Float32Array(3), 3));
        const points = new Points(geometry);
        points.frustumCulled = false;
        this.renderer.setRenderTarget(this.panes[0].resolve.target);
        for (const material of Object.values(this.materials.of({ colored, elliptic: false }))) {
            points.material = material;
            this.renderer.render(points, this.camera);
        }
        this.renderer.setRenderTarget(null);
        geometry.dispose();
    }

    /** Where the camera is at home changes with the cloud of the first pane. */
    placeFor(level) {
        this.home = level && { origin: level.origin, ...homeView(level.geometry) };
        if (this.home) {
            this.camera.up.copy(this.home.up);
            this.renewControls();
            this.fit({ glide: false });
            if (this.startView) {
                this.lookFrom(this.startView);
                this.startView = null;
            }
            this.controls.update();
        }
    }

    /**
     * From the origin of the cloud of the first pane to that of a level, which may be of another cloud. In doubles: origins are large.
     * None where they are so far apart that the coordinates of one must mean something else: nothing could be compared there.
     */
    wayTo({ origin = [0, 0, 0] }) {
        const way = new Vector3(...origin).sub(new Vector3(...(this.home?.origin ?? origin)));
        return way.length() > kApart * this.home?.reach ? way.set(0, 0, 0) : way;
    }

    /** Where a level is drawn, relative to the origin of the cloud of the first pane. */
    boxOf(level) {
        return level.geometry.boundingBox.clone().translate(this.wayTo(level));
    }

    /** From where it is looked at, null: from home. Places of the camera and of what it turns around, from the cloud's middle in its radii. */
    get view() {
        if (!this.home || this.isAtHome) {
            return this.startView;
        }
        return [...this.camera.position, ...this.controls.target].map((x) => Number((x / this.home.radius).toPrecision(kViewDigits)));
    }

    lookFrom(view) {
        const [position, target] = [view.slice(0, 3), view.slice(3)].map((place) => new Vector3(...place).multiplyScalar(this.home.radius));
        this.glide = null;
        this.camera.position.copy(position);
        this.controls.target.copy(target);
        this.isAtHome = false;
        this.changed();
    }

    /** @param mode  `one`: the first pane alone; `swipe`: the same view of both, with a line at `at`; `beside`: one beside the other */
    setSplit(split) {
        const isOther = split.mode !== undefined && split.mode !== this.split.mode;
        Object.assign(this.split, split);
        this.controls.zoomToCursor = this.split.mode !== 'beside';
        if (isOther) {
            this.refit();
        }
        this.changed();
    }

    /** @param splatSize  1: as measured; @param shading  of edges and hollows, 1: as designed */
    setLook(look) {
        Object.assign(this.look, look);
        this.changed();
    }

    /** OrbitControls read the camera's up once, when they are made. */
    renewControls() {
        this.controls?.dispose();
        this.controls = new OrbitControls(this.camera, this.canvas);
        Object.assign(this.controls, {
            enableDamping: true,
            rotateSpeed: 0.75,
            minDistance: kNearest * (this.home?.radius ?? 1),
            maxDistance: kFarthest * (this.home?.radius ?? 1),
            zoomToCursor: this.split?.mode !== 'beside',
            autoRotate: this.autoRotate,
            autoRotateSpeed: 60 * kTurnsPerSecond,
        });
        this.controls.addEventListener('change', () => this.hasMoved() && this.changed());
        this.controls.addEventListener('end', () => !this.resting && this.onMoved());  // where frames are slow it takes long to come to rest
        this.controls.addEventListener('start', () => {
            this.glide = null;
            this.isAtHome = false;
        });
    }

    setAutoRotate(on) {
        this.autoRotate = on;
        this.isAtHome &&= !on;
        this.controls.autoRotate = on;
        this.changed();
    }

    /** By keys: to the left and up in turns, nearer by a factor. */
    turn(left, up, nearer = 1) {
        this.glide = null;
        this.isAtHome = false;
        this.controls.rotateLeft(2 * Math.PI * left);
        this.controls.rotateUp(2 * Math.PI * up);
        this.controls.dollyIn(1 / nearer);
    }

    /** By keys: pixels to the left and up. */
    pan(left, up) {
        this.glide = null;
        this.isAtHome = false;
        this.controls.pan(left, up);
    }

    /** Linear colour of clouds that bring none. */
    setTint(red, green, blue) {
        this.materials.uniforms.tint.value.set(red, green, blue);
        this.changed();
    }

    /** The part of the canvas that panels cover: the cloud is centred in the rest, and fills it unless the camera was moved. */
    setInsets(insets) {
        this.insets = insets;
        this.refit();
        this.changed();
    }

    /** For another room; where the camera was moved, it stays. */
    refit() {
        if (this.isAtHome) {
            this.fit({ glide: this.glide !== null });
        }
    }

    /** The whole cloud, from where it is looked at best. */
    fit({ glide = true } = {}) {
        if (this.home) {
            const { target, distance } = this.fitting(this.home.direction);
            this.moveTo(target, this.home.direction, distance, glide);
            this.isAtHome = !this.autoRotate;
        }
    }

    /** For a finer level that reaches farther than what the camera was placed for. Nothing else moves it while levels come. */
    stepBack() {
        const away = this.camera.position.distanceTo(this.controls.target);
        if (this.isAtHome && !this.glide && this.fitting(this.home.direction).distance > kNotable * away) {
            this.fit();
        }
    }

    /** Where the splats (but for strays) are seen in the middle between the cards, along `direction`: the `target`, and how far from it. */
    fitting(direction) {
        const [{ height, free }] = this.views();
        const perPixel = 2 * Math.tan(MathUtils.degToRad(kFieldOfView / 2)) / Math.max(1, height);
        const slopeX = 0.5 * free.width * perPixel / kMargin;
        const slopeY = 0.5 * free.height * perPixel / kMargin;
        const right = new Vector3().crossVectors(this.camera.up, direction).normalize();
        const up = new Vector3().crossVectors(direction, right);
        const { geometry, spacing } = this.panes[0].level;
        const position = geometry.getAttribute('position');
        // Of more points discs are small, and smaller in the finer levels for which the view stays.
        const radiusOf = position.count <= kFewPoints ? radiiOf(geometry, spacing, this.home.radius) : () => 0;
        const step = Math.ceil(position.count / kFittedPoints);
        const point = new Vector3();
        const splats = [];
        for (let i = 0; i < position.count; i += step) {
            point.fromBufferAttribute(position, i);
            if (this.home.box?.containsPoint(point) === false) {
                continue;
            }
            point.sub(this.home.center);
            const [x, y, depth] = [right, up, direction].map((axis) => point.dot(axis));
            const radius = this.look.splatSize * radiusOf(i);
            splats.push({ x, y, depth, radius, aside: Math.max((Math.abs(x) + radius) / slopeX, (Math.abs(y) + radius) / slopeY) });
        }
        const needed = Float64Array.from(splats, ({ depth, aside }) => depth + aside).sort();
        const distance = Math.max(0.5 * this.home.radius, needed[Math.ceil(kFittedShare * (needed.length - 1))]);
        const seen = splats.filter(({ depth, aside }) => depth + aside / kMargin <= distance);  // also in the margin
        return { distance, target: right.multiplyScalar(middleOf(seen, 'x', distance)).addScaledVector(up, middleOf(seen, 'y', distance)) };
    }

    /** The same as at the pointer, in the middle of what is seen. */
    focusMiddle() {
        const [{ left, width, height, shiftX, shiftY }] = this.views();
        this.focusAt(left + width / 2 - shiftX, height / 2 - shiftY);
    }

    /** Turns around the point at a place of the canvas and comes closer to it; tells its `place` in the file, `level`, `geometry` and `index`. */
    focusAt(x, y) {
        const view = this.views().find(({ clip }) => x >= clip.left && x < clip.right);
        const hit = view?.pane.level && this.pick(view, x - view.left, y);
        if (hit) {
            const direction = this.camera.position.clone().sub(this.controls.target).normalize();
            this.moveTo(hit.place, direction, 0.45 * this.camera.position.distanceTo(hit.place), true);
            this.isAtHome = false;
            const { center, origin = [0, 0, 0] } = this.home;
            this.onPoint({ ...hit, level: view.pane.level, place: hit.place.clone().add(center).toArray().map((x, axis) => x + origin[axis]) });
        }
    }

    /** Comes close to a place of the file, from where the camera is, or from the other side of the cloud where it would lie behind. */
    lookAt(place) {
        const { center, origin = [0, 0, 0], radius } = this.home;
        const target = new Vector3(...place.map((x, axis) => x - origin[axis])).sub(center);
        const direction = this.camera.position.clone().sub(this.controls.target).normalize();
        const outward = target.clone().normalize();
        direction.addScaledVector(outward, Math.max(0, -2 * direction.dot(outward)));
        this.moveTo(target, direction, kClose * radius, true);
        this.isAtHome = false;
    }

    /** The nearest point drawn within a few pixels of a place in a view: `place`, relative to the centre, `geometry` and `index`. */
    pick(view, x, y) {
        this.aim(view);
        const point = new Vector3();
        let best = null;
        let bestDepth = Infinity;
        for (const { geometry, matrixWorld } of view.pane.scene.children) {
            const position = geometry.getAttribute('position');
            const toClip = this.camera.projectionMatrix.clone().multiply(this.camera.matrixWorldInverse).multiply(matrixWorld);
            for (let i = 0; i < position.count; i += 1) {
                point.fromBufferAttribute(position, i).applyMatrix4(toClip);
                const dx = (0.5 + 0.5 * point.x) * view.width - x;
                const dy = (0.5 - 0.5 * point.y) * view.height - y;
                if (dx * dx + dy * dy < kPickPixels ** 2 && Math.abs(point.z) <= 1 && point.z < bestDepth) {
                    bestDepth = point.z;
                    best = { place: new Vector3().fromBufferAttribute(position, i).applyMatrix4(matrixWorld), geometry, index: i };
                }
            }
        }
        return best;
    }

    moveTo(target, direction, distance, glide) {
        const to = { target: target.clone(), position: target.clone().addScaledVector(direction, distance) };
        if (!glide || matchMedia('(prefers-reduced-motion: reduce)').matches) {
            this.glide = null;
            this.controls.target.copy(to.target);
            this.camera.position.copy(to.position);
            this.camera.lookAt(to.target);
        } else {
            this.glide = {
                from: { target: this.controls.target.clone(), position: this.camera.position.clone() },
                to,
                start: performance.now(),
            };
        }
        this.changed();
    }

    /** What is seen, in the middle and without a background. @returns {Promise<Blob>} a PNG */
    picture() {
        const { insets } = this;
        this.insets = { left: 0, right: 0, top: 0, bottom: 0 };
        const refit = () => this.isAtHome && this.fit({ glide: false });
        refit();
        this.draw(this.samplesAtRest());
        const copy = document.createElement('canvas');
        [copy.width, copy.height] = [this.canvas.width, this.canvas.height];
        copy.getContext('2d').drawImage(this.canvas, 0, 0);  // before the browser shows it, and forgets it
        this.insets = insets;
        refit();
        this.draw(1);
        this.changed();
        return new Promise((resolve, reject) => {
            copy.toBlob((blob) => (blob ? resolve(blob) : reject(new Error('The browser could not make a PNG of this size: make the window smaller.'))));
        });
    }

    changed() {
        this.dirty = true;
        this.resting = false;
        this.changedAt = performance.now();
        document.documentElement.dataset.picture = 'moving';
    }

    frame(now) {
        if (this.glide) {
            this.advanceGlide();
        }
        const seconds = Math.min(kLongestFrameS, (now - this.frameAt) / 1000);
        this.controls.dampingFactor = 1 - kLeftPerSecond ** seconds;
        this.controls.update(seconds);
        this.frameAt = now;
        if (this.hasMoved()) {
            this.changed();
        }
        if (this.dirty) {
            this.dirty = false;
            this.draw(1);
        } else if (!this.resting && performance.now() - this.changedAt > kRestMs && !this.finishInertia()) {
            this.resting = true;
            this.draw(this.samplesAtRest());
            document.documentElement.dataset.picture = 'rest';
            this.onMoved();
            if (!this.isWarm) {
                this.isWarm = true;
                this.warmUp({ colored: true });
            }
        }
    }

    /** So that it is seen, since the last picture. The controls tell of too little in small clouds, and of too much at their limits. */
    hasMoved() {
        const { camera: { position }, controls: { target }, seen } = this;
        const still = kStill * position.distanceTo(target);
        return position.distanceTo(seen.position) > still || target.distanceTo(seen.target) > still;
    }

    /** Per pixel and axis: more than one where pixels are seen, and only as far as the graphics card has room. */
    samplesAtRest() {
        const sides = this.views().map(({ width, height }) => [width, height].map((side) => 2 * devicePixelRatio * side));
        const all = sides.reduce((sum, [width, height]) => sum + width * height, 0);
        return devicePixelRatio >= 2 || all > kMostSamples || Math.max(...sides.flat()) > this.renderer.capabilities.maxTextureSize ? 1 : 2;
    }

    /** Takes what is left of a damped movement, too little to be seen, in one step: where frames are slow it would go on for seconds. @return whether there was any */
    finishInertia() {
        this.controls.enableDamping = false;
        this.controls.update(0);
        this.controls.enableDamping = true;
        return this.hasMoved();
    }

    advanceGlide() {
        const { from, to, start } = this.glide;
        const t = Math.min(1, (performance.now() - start) / kGlideMs);
        const eased = 1 - (1 - t) ** 3;
        this.controls.target.lerpVectors(from.target, to.target, eased);
        this.camera.position.lerpVectors(from.position, to.position, eased);
        if (t === 1) {
            this.glide = null;
        }
        this.changed();
    }

    /**
     * Where the panes are drawn, in pixels of the page: the whole picture of each (`left`, `width`, `height`), what of it is seen
     * (`clip`), the part that no card covers (`free`) and how far the middle of that is from the middle of the picture.
     */
    views() {
        const width = this.canvas.clientWidth;
        const height = this.canvas.clientHeight;
        const { left, right, top, bottom } = this.insets;
        const view = (pane, from, to, clip, coveredLeft, coveredRight) => ({
            pane, left: from, width: to - from, height, clip,
            free: { width: Math.max(80, to - from - coveredLeft - coveredRight), height: Math.max(80, height - top - bottom) },
            shiftX: (coveredRight - coveredLeft) / 2, shiftY: (bottom - top) / 2,
        });
        const [first, second] = this.panes;
        if (this.split.mode === 'swipe') {
            const line = this.line();
            return [view(first, 0, width, { left: 0, right: line }, left, right),
                view(second, 0, width, { left: line, right: width }, left, right)];
        }
        if (this.split.mode === 'beside') {
            const line = this.line();
            return [view(first, 0, line, { left: 0, right: line }, left, 0),
                view(second, line, width, { left: line, right: width }, 0, right)];
        }
        return [view(first, 0, width, { left: 0, right: width }, left, right)];
    }

    /** Where the line between two panes is: beside each other both have the same room. */
    line() {
        const { left, right } = this.insets;
        const at = this.split.mode === 'beside' ? 0.5 : this.split.at;
        return Math.round(left + at * (this.canvas.clientWidth - left - right));
    }

    /** @param samples  per pixel and axis: 1 while something moves */
    draw(samples) {
        this.seen.position.copy(this.camera.position);
        this.seen.target.copy(this.controls.target);
        const views = this.views();
        if (views.some(({ width, height }) => width <= 0 || height <= 0)) {
            return;
        }
        const ratio = Math.min(devicePixelRatio, 2);
        this.renderer.setPixelRatio(ratio);
        this.renderer.setSize(this.canvas.clientWidth, this.canvas.clientHeight, false);
        this.renderer.setRenderTarget(null);
        this.renderer.setScissorTest(false);
        this.renderer.setClearColor(0x000000, 0);
        this.renderer.clear();
        for (const view of views) {
            this.aim(view);
            view.pane.draw(view, ratio, samples);
        }
    }

    /** Turns the camera's picture into that of a view. Depth is spent on the cloud alone, near it on what is looked at. */
    aim({ pane, width, height, shiftX, shiftY }) {
        const radius = kSlack * (this.home?.radius ?? 1), reach = kSlack * (this.home?.reach ?? 1);
        const distance = this.camera.position.length();
        let [nearest, farthest] = [distance - radius, distance + reach];
        if (pane.level && !pane.isFirst) {  // which may be of another cloud
            const { center, radius: other } = pane.level.geometry.boundingSphere;
            const away = center.clone().add(this.wayTo(pane.level)).sub(this.home.center).distanceTo(this.camera.position);
            [nearest, farthest] = [Math.min(nearest, away - kSlack * other), Math.max(farthest, away + kSlack * other)];
        }
        this.camera.aspect = width / height;
        this.camera.near = Math.max(nearest, 2e-3 * radius);
        this.camera.far = Math.max(farthest, 2 * this.camera.near);
        this.camera.setViewOffset(width, height, shiftX, shiftY, width, height);
        this.camera.updateMatrixWorld();
    }
}

/** From where on an axis splats reach equally far to either side of a picture, which is not their middle: what is near looks larger. */
function middleOf(splats, axis, distance) {
    const farthest = (sign) => splats.reduce((most, { [axis]: at, depth, radius }) => {
        const away = Math.max(kNearest * distance, distance - depth);
        const slope = (sign * at + radius) / away;
        return slope > most.slope ? { slope, away } : most;
    }, { slope: -Infinity });
    const [ahead, behind] = [farthest(1), farthest(-1)];
    return (ahead.slope - behind.slope) / (1 / ahead.away + 1 / behind.away);
}

/** How far the splat of point i reaches. */
function radiiOf(geometry, spacing, size) {
    const major = geometry.getAttribute('major');
    const surface = geometry.getAttribute('surface');
    return major ? (i) => kEllipseOverlap * Math.hypot(major.getX(i), major.getY(i), major.getZ(i))
        : (i) => surface.getW(i) * largestRadiusOf(spacing, size);
}

/** The box of most of a cloud where a few points lie far off, else null: by all the others would be a dot. */
function boxWithoutStrays(geometry) {
    const whole = geometry.boundingBox;
    const position = geometry.getAttribute('position');
    const step = Math.ceil(position.count / kAskedForMost);
    const most = new Box3();
    ['x', 'y', 'z'].forEach((axis, k) => {
        const values = Float32Array.from({ length: Math.ceil(position.count / step) }, (_, i) => position.getComponent(i * step, k)).sort();
        const few = Math.floor(values.length * kFewShare);
        [most.min[axis], most.max[axis]] = [values[few], values[values.length - 1 - few]];
    });
    const longest = (box) => Math.max(...box.getSize(new Vector3()));
    const side = longest(most);
    return side > 0 && longest(whole) > kFarOff * side ? most.expandByScalar(kAround * side).intersect(whole) : null;
}

/**
 * Where a cloud is looked at from. Terrain lies flat, mostly along z; what stands does so along y. `box` is null or what alone is looked at,
 * `radius` that of what is, and `reach` how far points are from its centre.
 */
function homeView(geometry) {
    const box = boxWithoutStrays(geometry);
    const whole = geometry.boundingSphere;
    const { center, radius } = box?.getBoundingSphere(new Sphere()) ?? whole;
    const size = (box ?? geometry.boundingBox).getSize(new Vector3());
    const liesAlongZ = size.z < 0.5 * Math.min(size.x, size.y);
    const liesAlongY = size.y < 0.5 * Math.min(size.x, size.z);
    const direction = liesAlongZ ? new Vector3(-0.45, -1, 0.75)
        : liesAlongY ? new Vector3(0.4, 0.75, 1) : new Vector3(0.32, 0.2, 1);
    return {
        box,
        center: center.clone(),
        radius: radius || 1,
        reach: center.distanceTo(whole.center) + whole.radius,
        up: liesAlongZ ? new Vector3(0, 0, 1) : new Vector3(0, 1, 0),
        direction: direction.normalize(),
    };
}
