// The pages of the test: bundled around the lines of the README, and served from a site that is not stipple's.
import { existsSync, readFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { createRequire } from 'node:module';
import { dirname, extname, join, normalize, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';

const kPages = join(dirname(fileURLToPath(import.meta.url)), 'pages');
const kMediaTypes = {
    '.html': 'text/html; charset=utf-8', '.js': 'text/javascript; charset=utf-8', '.json': 'application/json',
    '.wasm': 'application/wasm', '.css': 'text/css', '.png': 'image/png', '.jpg': 'image/jpeg', '.svg': 'image/svg+xml',
};

/** The indented lines of the README below `// name…`, up to the next empty one. */
export function linesOf(readme, name) {
    const lines = readme.split('\n');
    const at = lines.findIndex((line) => line.startsWith(`    // ${name}`));
    if (at < 0) {
        throw new Error(`the README has no lines for ${name}`);
    }
    return lines.slice(at + 1, lines.indexOf('', at)).map((line) => line.slice(4));
}

/** The module `readme:NAME?RESULTS`: its function `show` runs the lines of that name and returns their variables RESULTS. */
const fromReadme = (file, modules) => ({
    name: 'readme',
    setup(build) {
        build.onResolve({ filter: /^readme:/ }, ({ path }) => ({ path: path.slice('readme:'.length), namespace: 'readme' }));
        build.onLoad({ filter: /.*/, namespace: 'readme' }, ({ path }) => {
            const [name, results] = path.split('?');
            const lines = linesOf(readFileSync(file, 'utf8'), name);
            const isImport = (line) => line.startsWith('import ');
            const body = lines.filter((line) => !isImport(line)).join('\n');
            return {
                contents: `${lines.filter(isImport).join('\n')}
export async function show({ server, job, scene, camera, renderer, viewer }) {
${body}
return { ${results} };
}`,
                resolveDir: modules,
            };
        });
    },
});

/** The bundle of a script; `name` of one in pages/, or a path. */
export async function bundled(name, { readme, modules }) {
    const esbuild = createRequire(join(modules, 'package.json'))('esbuild');
    const { outputFiles } = await esbuild.build({
        entryPoints: [resolve(kPages, `${name}.js`)],
        nodePaths: [modules],
        plugins: [fromReadme(readme, modules)],
        define: { CESIUM_BASE_URL: '"/cesium/"' },
        bundle: true,
        write: false,
        format: 'esm',
        target: 'es2022',
        logLevel: 'error',
    });
    return outputFiles[0].contents;
}

/** Serves each page NAME at /pages/NAME/, and beside the pages what viewers fetch by themselves, and other `folders`, by address. */
export async function servePages(bundles, modules, others) {
    const folders = { '/cesium/': join(modules, 'cesium/Build/Cesium'), '/draco/': join(modules, 'three/examples/jsm/libs/draco'), ...others };
    const found = (path) => {
        const [, name, file] = /^\/pages\/(\w+)\/(.*)$/.exec(path) ?? [];
        if (name in bundles && file === '') {
            return join(kPages, 'index.html');
        }
        if (name in bundles && file === 'page.js') {
            return bundles[name];
        }
        const folder = Object.keys(folders).find((start) => path.startsWith(start));
        return folder && join(folders[folder], normalize(path.slice(folder.length - 1)));
    };
    const http = createServer((request, response) => {
        const { pathname } = new URL(request.url, 'http://here');
        const what = found(pathname);
        if (!what || typeof what === 'string' && !existsSync(what)) {
            response.writeHead(404).end();
            return;
        }
        response.writeHead(200, { 'Content-Type': kMediaTypes[extname(pathname) || '.html'] ?? 'application/octet-stream' });
        response.end(typeof what === 'string' ? readFileSync(what) : what);
    });
    await new Promise((resolve) => { http.listen(0, '127.0.0.1', resolve); });
    return { url: `http://127.0.0.1:${http.address().port}`, close: () => http.close() };
}
