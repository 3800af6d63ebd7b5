import { Cartesian3, CesiumWidget, Matrix4 } from 'cesium';
import { show } from 'readme:Cesium?tileset';

import { job, server, tell, view } from './asked.js';

const viewer = new CesiumWidget('stage', {
    globe: false, skyBox: false, skyAtmosphere: false, baseLayer: false, creditContainer: document.createElement('div'),
    contextOptions: { webgl: { preserveDrawingBuffer: true } },
});
const { tileset } = await show({ server, job, viewer });
tileset.maximumScreenSpaceError = 1;  // every level, down to the finest tiles
tileset.pointCloudShading.maximumAttenuation = 16;  // of the default error: with that above points were cut to a pixel
tileset.pointCloudShading.eyeDomeLighting = !view.isFlat;  // it darkens what lies behind

const place = ([x, y, z]) => Matrix4.multiplyByPoint(tileset.modelMatrix, new Cartesian3(x, y, z), new Cartesian3());
const along = ([x, y, z]) => Cartesian3.normalize(
    Matrix4.multiplyByPointAsVector(tileset.modelMatrix, new Cartesian3(x, y, z), new Cartesian3()), new Cartesian3());
viewer.camera.frustum.fov = view.fov * Math.PI / 180;
viewer.camera.setView({
    destination: place(view.eye),
    orientation: { direction: along(view.target.map((x, k) => x - view.eye[k])), up: along(view.up) },
});

let points = 0;
viewer.scene.preRender.addEventListener(() => { points = 0; });
tileset.tileVisible.addEventListener(({ content }) => { points += content.pointsLength; });
tileset.allTilesLoaded.addEventListener(() => {
    viewer.scene.postRender.addEventListener(() => tell({ points }));
});
