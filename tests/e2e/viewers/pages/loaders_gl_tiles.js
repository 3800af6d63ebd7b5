import { load } from '@loaders.gl/core';
import { Tiles3DLoader } from '@loaders.gl/3d-tiles';
import { TILE_REFINEMENT } from '@loaders.gl/tiles';
import { BufferAttribute, BufferGeometry, Group, Points, PointsMaterial } from 'three';
import { show } from 'readme:loaders.gl, tile by tile?tileset,contents';

import { job, server, tell } from './asked.js';
import { camera, renderer, scene } from './three_scene.js';

const { tileset, contents } = await show({ server, job });
if (contents.length === 0 || contents.some(({ gltf }) => !gltf)) {
    throw new Error(`${contents.length} tiles to begin with`);
}
const placed = new Group();
placed.matrixAutoUpdate = false;
placed.matrix.fromArray(tileset.root.transform);
scene.add(placed);

let points = 0;
for (const tile of finest(tileset.root)) {
    const { gltf } = await load(tile.contentUrl, Tiles3DLoader);
    const upright = new Group();
    upright.rotation.x = Math.PI / 2;  // y up becomes z up
    placed.add(upright);
    gltf.scene.nodes.forEach((node) => upright.add(drawn(node, tile.extras.spacing)));
}
renderer.render(scene, camera);
tell({ points });

/** The tiles that show all there is. */
function finest(tile) {
    const below = (tile.children ?? []).flatMap(finest);
    const isReplaced = below.length > 0 && tile.refine === TILE_REFINEMENT.REPLACE;
    return isReplaced || !tile.contentUrl ? below : [tile, ...below];
}

function drawn({ matrix, translation, rotation, scale, mesh, children = [] }, spacing) {
    const group = new Group();
    if (matrix) group.applyMatrix4(group.matrix.clone().fromArray(matrix));
    if (translation) group.position.fromArray(translation);
    if (rotation) group.quaternion.fromArray(rotation);
    if (scale) group.scale.fromArray(scale);
    for (const { attributes } of mesh?.primitives ?? []) {
        const geometry = new BufferGeometry();
        geometry.setAttribute('position', attributeOf(attributes.POSITION));
        if (attributes.COLOR_0) geometry.setAttribute('color', attributeOf(attributes.COLOR_0));
        points += attributes.POSITION.count;
        group.add(new Points(geometry, new PointsMaterial({ size: 2 * spacing, vertexColors: Boolean(attributes.COLOR_0) })));
    }
    children.forEach((child) => group.add(drawn(child, spacing)));
    return group;
}

function attributeOf({ value, components, normalized }) {
    return new BufferAttribute(value, components, normalized);
}
