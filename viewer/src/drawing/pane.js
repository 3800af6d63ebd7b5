import { MathUtils, Points, Scene } from 'three';

import { colorizeTile } from './coloring.js';
import { ResolvePass } from './resolve_pass.js';
import { kEllipseOverlap, largestRadiusOf } from './splat_materials.js';

const kStep = 0.3;  // from one splat to the next of the same surface, spacings

/** One level at a time on its part of the stage. */
export class Pane {
    constructor(stage, onPicture) {
        this.stage = stage;
        this.onPicture = onPicture;
        this.scene = new Scene();
        this.resolve = new ResolvePass();
        this.level = null;
        this.showsTiles = false;      // of the level; until all are there that are seen, what stands in for them
        this.splats = new WeakMap();  // by geometry
    }

    get isFirst() {
        return this === this.stage.panes[0];
    }

    /** Empties it for another cloud. The second one may not be needed again: its target is large, and made anew when it is drawn. */
    clear() {
        this.scene.clear();
        this.level = null;
        if (this.isFirst) {
            this.stage.placeFor(null);
        } else {
            this.resolve.target.dispose();
        }
        this.stage.changed();
    }

    /** Shows a level in place of the one before; the first one of a cloud also places the camera. */
    show(level) {
        const before = this.level;
        this.showsTiles &&= level === this.level;
        this.level = level;
        if (this.isFirst && !before) {
            this.stage.placeFor(level);
            this.stage.draw(1);  // not a frame later: the next level may be decoded by then
        } else if (this.isFirst && level.points > before.points) {
            this.stage.stepBack();
        }
        this.stage.changed();
    }

    /** Puts the level's splats, or those of the tiles that are to be seen, where the camera looks. */
    arrange(height) {
        const { camera, home } = this.stage;
        const { tiles, geometry, spacing, coloring } = this.level;
        const way = this.stage.wayTo(this.level);
        this.scene.clear();
        if (tiles) {
            const origin = tiles.center.clone().add(way);
            const offset = origin.clone().sub(home.center);
            const drawn = tiles.select(camera, this.level, { offset, height });
            this.showsTiles ||= tiles.isComplete;
            tiles.note(this.level, this.showsTiles ? drawn : null);
            if (this.showsTiles) {
                for (const tile of drawn) {
                    colorizeTile(tile, coloring.by, coloring.range, origin);
                    this.scene.add(this.splatsOf(tile.cloud, tile.shownSpacing, offset));
                }
                return;
            }
        }
        this.scene.add(this.splatsOf(geometry, spacing, way.sub(home.center)));
    }

    splatsOf(geometry, spacing, position) {
        const { look, home } = this.stage;
        if (!this.splats.has(geometry)) {
            const points = new Points(geometry);
            points.frustumCulled = false;
            const radius = () => geometry.hasAttribute('major') ? kEllipseOverlap
                : largestRadiusOf(points.userData.spacing, home.radius);
            points.onBeforeRender = (renderer, scene, camera, _, material) => {
                material.uniforms.largestRadius.value = look.splatSize * radius();
                material.uniformsNeedUpdate = true;
            };
            this.splats.set(geometry, points);
        }
        const points = this.splats.get(geometry);
        points.userData.spacing = spacing;
        points.position.copy(position);
        return points;
    }

    draw(view, ratio, samples) {
        if (!this.level) {
            return;  // the canvas is clear
        }
        const { renderer, camera, look } = this.stage;
        const pixels = (length) => Math.round(length * ratio);
        this.resolve.setSize(pixels(view.width), pixels(view.height), samples);
        this.drawSplats(view, ratio * samples);
        const spacings = this.scene.children.map(({ userData }) => userData.spacing);
        this.resolve.render(renderer, camera, {
            view, ratio, reach: 1.2 * ratio * samples, shading: look.shading, stepHeight: kStep * look.splatSize * Math.min(...spacings),
        });
        this.onPicture(this.level);
    }

    /** @param scale  samples to a pixel of the page */
    drawSplats({ left, height, clip }, scale) {
        const { renderer, camera, materials, home, largestPointSize } = this.stage;
        const { target } = this.resolve;
        target.scissorTest = true;
        target.scissor.set((clip.left - left) * scale, 0, (clip.right - clip.left) * scale, target.height);
        renderer.setRenderTarget(target);
        renderer.setClearColor(0x000000, 0);
        renderer.clear();
        if (!home) {
            return;
        }
        this.arrange(height * renderer.getPixelRatio());
        const all = (name) => this.scene.children.every(({ geometry }) => geometry.hasAttribute(name));
        const { depth, blend } = materials.of({ colored: all('color'), elliptic: all('major') });
        const { uniforms } = materials;
        uniforms.pixelsPerUnit.value = 0.5 * height * scale / Math.tan(MathUtils.degToRad(camera.fov / 2));
        uniforms.smallestPixels.value = (this.level.points < 100 ? 9 : 1.6) * scale;
        uniforms.largestPixels.value = largestPointSize;
        uniforms.up.value.copy(camera.up).transformDirection(camera.matrixWorldInverse);
        for (const material of [depth, blend]) {
            this.scene.overrideMaterial = material;
            renderer.render(this.scene, camera);
        }
    }
}
