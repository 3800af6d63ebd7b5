import { MathUtils, Points, Scene } from 'three';

import { ResolvePass } from './resolve_pass.js';
import { largestRadiusOf } from './splat_materials.js';

/** One level at a time on its part of the stage. */
export class Pane {
    constructor(stage, onPicture) {
        this.stage = stage;
        this.onPicture = onPicture;
        this.scene = new Scene();
        this.resolve = new ResolvePass();
        this.level = null;
    }

    get isFirst() {
        return this === this.stage.panes[0];
    }

    /** Empties it for another cloud. */
    clear() {
        this.scene.clear();
        this.level = null;
        if (this.isFirst) {
            this.stage.placeFor(null);
        }
        this.stage.changed();
    }

    /** Shows a level in place of the one before; the first one of a cloud also places the camera. */
    show(level) {
        const isNew = this.level === null;
        this.level = level;
        this.points = new Points(level.geometry);
        this.points.frustumCulled = false;
        this.scene.clear();
        this.scene.add(this.points);
        if (this.isFirst && isNew) {
            this.stage.placeFor(level.geometry);
            this.place();
            this.stage.draw(1);  // not a frame later: the next level may be decoded by then
        }
        this.stage.changed();
    }

    place() {
        this.points.position.copy(this.stage.home.center).negate();
        this.points.updateMatrixWorld();
    }

    draw(view, ratio, samples) {
        const { renderer, camera, look } = this.stage;
        const pixels = (length) => Math.round(length * ratio);
        this.resolve.setSize(pixels(view.width), pixels(view.height), samples);
        this.drawSplats(view, ratio * samples);
        this.resolve.render(renderer, camera, { view, ratio, reach: 1.2 * ratio * samples, shading: look.shading });
        if (this.level) {
            this.onPicture(this.level);
        }
    }

    /** @param scale  samples to a pixel of the page */
    drawSplats({ left, height, clip }, scale) {
        const { renderer, camera, materials, look, home, largestPointSize } = this.stage;
        const { target } = this.resolve;
        target.scissorTest = true;
        target.scissor.set((clip.left - left) * scale, 0, (clip.right - clip.left) * scale, target.height);
        renderer.setRenderTarget(target);
        renderer.setClearColor(0x000000, 0);
        renderer.clear();
        if (!this.level || !home) {
            return;
        }
        this.place();
        const { uniforms, depth, blend } = materials[this.level.geometry.hasAttribute('color')];
        uniforms.largestRadius.value = look.splatSize * largestRadiusOf(this.level.spacing, home.radius);
        uniforms.pixelsPerUnit.value = 0.5 * height * scale / Math.tan(MathUtils.degToRad(camera.fov / 2));
        uniforms.smallestPixels.value = (this.level.points < 100 ? 9 : 1.6) * scale;
        uniforms.largestPixels.value = largestPointSize;
        uniforms.up.value.copy(camera.up).transformDirection(camera.matrixWorldInverse);
        for (const material of [depth, blend]) {
            this.points.material = material;
            renderer.render(this.scene, camera);
        }
    }
}
