// As the README has it, without a place of one's own: the tileset says where it stands.
import { CesiumWidget, Cesium3DTileset, HeadingPitchRange } from 'cesium';

import { job, server, tell, view } from './asked.js';

const viewer = new CesiumWidget('stage', {
    globe: false, skyBox: false, skyAtmosphere: false, baseLayer: false, creditContainer: document.createElement('div'),
    contextOptions: { webgl: { preserveDrawingBuffer: true } },
});
const tileset = await Cesium3DTileset.fromUrl(`${server}/v1/pyramids/${job}/tileset.json`, { pointCloudShading: { attenuation: true } });
tileset.maximumScreenSpaceError = 1;  // every level, down to the finest tiles
tileset.pointCloudShading.maximumAttenuation = 16;  // as by default
viewer.scene.primitives.add(tileset);
viewer.camera.frustum.fov = view.fov * Math.PI / 180;
const { center, radius } = tileset.boundingSphere;
viewer.camera.flyToBoundingSphere(tileset.boundingSphere, { duration: 0, offset: new HeadingPitchRange(0.4, -0.5, 2.5 * radius) });

let points = 0;
viewer.scene.preRender.addEventListener(() => { points = 0; });
tileset.tileVisible.addEventListener(({ content }) => { points += content.pointsLength; });
tileset.allTilesLoaded.addEventListener(() => {
    viewer.scene.postRender.addEventListener(() => {
        const { positionWC: eye, directionWC: direction, upWC: up } = viewer.camera;
        const list = ({ x, y, z }) => [x, y, z];
        tell({
            points,
            center: list(center),
            eye: list(eye),
            view: { eye: [0, 0, 0], target: list(direction), up: list(up), fov: view.fov },  // from there
        });
    });
});
