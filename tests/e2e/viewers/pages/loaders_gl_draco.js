import { BufferAttribute, BufferGeometry, LinearSRGBColorSpace, Points, PointsMaterial } from 'three';
import { show } from 'readme:loaders.gl, one level?levels,origin,attributes';

import { job, server, tell } from './asked.js';
import { camera, renderer, scene } from './three_scene.js';

const { levels, origin, attributes } = await show({ server, job });
const geometry = new BufferGeometry();
geometry.setAttribute('position', attributeOf(attributes.POSITION));
if (attributes.COLOR_0) geometry.setAttribute('color', attributeOf(attributes.COLOR_0));
const points = new Points(geometry, new PointsMaterial({ size: 2 * levels.at(-1).spacing, vertexColors: Boolean(attributes.COLOR_0) }));
points.position.set(...origin);
scene.add(points);
renderer.outputColorSpace = LinearSRGBColorSpace;  // colours are shown as the file has them
renderer.render(scene, camera);
tell({ points: geometry.getAttribute('position').count });

function attributeOf({ value, size }) {
    return new BufferAttribute(value, size, value instanceof Uint8Array);
}
