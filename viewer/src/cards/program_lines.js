// Lines that show a result in other programs, with its address filled in: those of the README.

const kDraco = 'drc';
const kTiles = 'glb';
const tilesetOf = ({ server, id }) => `${server}/v1/pyramids/${id}/tileset.json`;
const manifestOf = ({ server, id, collection, manifest }) => `${server}/v1/${collection}/${id}/${manifest}`;

/** Of what says itself where on the globe it is, as with tiles.epsg, this would put it elsewhere. */
const kPlacing = `// Where on the globe
tileset.modelMatrix = Transforms.eastNorthUpToFixedFrame(
    Cartesian3.fromDegrees(8.55, 47.37));
`;

/** The finest level, or one that was chosen. */
const levelOf = ({ level }) => (level === null ? 'levels.at(-1)' : `levels[${level}]`);

/** Of a result `{server, id, collection, manifest, level, hasKey, isPlaced}`. */
export function linesOf({ linesFor, showsKey }, result) {
    const note = result.hasKey && !showsKey ? '// This server wants a key with each request: Authorization: Bearer KEY\n' : '';
    return note + linesFor(result);
}

/** Each with a `name`, the format of files that it `needs`, if any, `linesFor` a result, and whether these `showsKey` where one is needed. */
export const kPrograms = [{
    // It draws points as large as the error of their tile: that of leaves and twigs, many spacings, would make boxes of them.
    name: 'Cesium', needs: kTiles,
    linesFor: (result) => `import { ${result.isPlaced ? '' : 'Cartesian3, '}Cesium3DTileset${result.isPlaced ? '' : ', Transforms'} } from 'cesium';
const tileset = await Cesium3DTileset.fromUrl(
    '${tilesetOf(result)}?error=spacing', {
        maximumScreenSpaceError: 4,
        pointCloudShading: { attenuation: true, maximumAttenuation: 32, geometricErrorScale: 3 } });
${result.isPlaced ? '' : kPlacing}viewer.scene.primitives.add(tileset);`,
}, {
    name: 'three.js, tiles', needs: kTiles,
    linesFor: (result) => `import { TilesRenderer } from '3d-tiles-renderer';
import { GLTFExtensionsPlugin } from '3d-tiles-renderer/plugins';
import { MeshoptDecoder } from 'three/addons/libs/meshopt_decoder.module.js';
const tiles = new TilesRenderer(
    '${tilesetOf(result)}');
tiles.registerPlugin(new GLTFExtensionsPlugin({ meshoptDecoder: MeshoptDecoder }));
tiles.setCamera(camera);
tiles.setResolutionFromRenderer(camera, renderer);
const wide = 2 / Math.tan(camera.fov * Math.PI / 360);  // spacings
tiles.addEventListener('load-model', ({ scene: model, tile }) => model.traverse(({ material }) =>
    Object.assign(material ?? {}, { size: wide * tile.extras.spacing, sizeAttenuation: true })));
scene.add(tiles.group);  // call tiles.update() before each frame`,
}, {
    name: 'three.js, one level', needs: kDraco,
    linesFor: (result) => `// Copy three/examples/jsm/libs/draco/ to /draco/
import { Points, PointsMaterial } from 'three';
import { DRACOLoader } from 'three/addons/loaders/DRACOLoader.js';
const manifest = await fetch('${manifestOf(result)}');
const { levels } = await manifest.json();
const { spacing, origin, files } = ${levelOf(result)};
const { href } = files.find((file) => file.format === 'drc');
const geometry = await new DRACOLoader().setDecoderPath('/draco/')
    .loadAsync(new URL(href, manifest.url).href);
const points = new Points(geometry, new PointsMaterial({
    size: 2 * spacing / Math.tan(camera.fov * Math.PI / 360), vertexColors: geometry.hasAttribute('color') }));
points.position.set(...origin);
scene.add(points);`,
}, {
    name: 'loaders.gl, tiles', needs: kTiles,
    linesFor: (result) => `import { load } from '@loaders.gl/core';
import { Tiles3DLoader } from '@loaders.gl/3d-tiles';
const tileset = await load(
    '${tilesetOf(result)}', Tiles3DLoader);
const coarsest = (tile) => (tile.contentUrl ? [tile.contentUrl]
    : tile.children.flatMap(coarsest));  // finer ones are their children
const contents = await Promise.all(coarsest(tileset.root)
    .map((url) => load(url, Tiles3DLoader)));  // points are in the gltf of each`,
}, {
    name: 'loaders.gl, one level', needs: kDraco,
    linesFor: (result) => `import { load } from '@loaders.gl/core';
import { DracoLoader } from '@loaders.gl/draco';
const manifest = await fetch('${manifestOf(result)}');
const { levels } = await manifest.json();
const { origin, files } = ${levelOf(result)};  // positions are relative to origin
const { href } = files.find((file) => file.format === 'drc');
const { attributes } = await load(new URL(href, manifest.url).href, DracoLoader);`,
}, {
    name: 'curl', showsKey: true,
    linesFor: (result) => {
        const curl = `curl -sS${result.hasKey ? ' -H "Authorization: Bearer $STIPPLE_KEY"' : ''}`;
        const all = result.collection === 'pyramids' ? `
# All levels, tiles and the manifest
${curl} -o levels.tar ${result.server}/v1/pyramids/${result.id}.tar` : '';
        return `# What there is: points, errors, files
${curl} ${manifestOf(result)}${all}`;
    },
}];
