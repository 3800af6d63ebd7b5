// Bundles the page into a folder, with a brotli twin of every file, and writes the C++ source that builds them into the server.
//
//     node build.mjs [--modules node_modules] [--out dist]
import { createHash } from 'node:crypto';
import { mkdirSync, readdirSync, readFileSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { basename, dirname, extname, join, parse, relative, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { parseArgs } from 'node:util';
import { brotliCompressSync, constants } from 'node:zlib';

import { jobForms } from './job_forms.mjs';

const source = dirname(fileURLToPath(import.meta.url));
const { values: options } = parseArgs({
    options: {
        modules: { type: 'string', default: join(source, 'node_modules') },
        out: { type: 'string', default: join(source, 'dist') },
    },
});
const modules = resolve(options.modules);
const out = resolve(options.out);
const page = join(out, 'page');
const esbuild = createRequire(join(modules, 'package.json'))('esbuild');

const mediaTypes = {
    '.html': 'text/html; charset=utf-8',
    '.css': 'text/css; charset=utf-8',
    '.js': 'text/javascript; charset=utf-8',
    '.wasm': 'application/wasm',
    '.svg': 'image/svg+xml',
};

rmSync(page, { recursive: true, force: true });
mkdirSync(join(page, 'assets'), { recursive: true });
const assets = placePlainFiles();
assets['surface_worker.js'] = place('surface_worker.js', await bundle('src/loading/surface_worker.js'));
assets['viewer.js'] = place('viewer.js', await bundle('src/main.js', {
    ASSETS: JSON.stringify(assets),
    JOB_FORMS: JSON.stringify(jobForms(join(source, '../openapi.yaml'), modules)),
}));
placePage();
writeFileSync(join(out, 'viewer_files.cpp'), cppSource(filesUnder(page).map(describe)));

/** Puts a file where it is served from, under a name with a hash of its bytes, so that it can be cached for ever; its URL, relative to the page's. */
function place(name, bytes) {
    const { name: stem, ext } = parse(name);
    const url = `assets/${stem}-${digest(bytes).slice(0, 12)}${ext}`;
    writeFileSync(join(page, url), bytes);
    return url;
}

function placePlainFiles() {
    // The full decoder: the smaller one under libs/draco/gltf cannot decode point clouds.
    const draco = join(modules, 'three/examples/jsm/libs/draco');
    const paths = [join(draco, 'draco_wasm_wrapper.js'), join(draco, 'draco_decoder.wasm'), join(source, 'style.css'), join(source, 'icon.svg')];
    return Object.fromEntries(paths.map((path) => [basename(path), place(basename(path), readFileSync(path))]));
}

async function bundle(entry, define = {}) {
    const result = await esbuild.build({
        entryPoints: [join(source, entry)],
        write: false,
        nodePaths: [modules],
        bundle: true,
        minify: true,
        format: 'esm',
        target: 'es2022',
        legalComments: 'eof',
        logLevel: 'warning',
        define,
    });
    return result.outputFiles[0].contents;
}

/** The page names its files as they are called in the sources. */
function placePage() {
    const html = readFileSync(join(source, 'index.html'), 'utf8');
    writeFileSync(join(page, 'index.html'), html.replaceAll(/assets\/([\w.]+)/g, (_, name) => assets[name]));
}

function digest(bytes) {
    return createHash('sha256').update(bytes).digest('hex');
}

function filesUnder(folder) {
    return readdirSync(folder).flatMap((name) => {
        const path = join(folder, name);
        return statSync(path).isDirectory() ? filesUnder(path) : [path];
    });
}

/** What viewer_files.hpp tells of a file; writes the brotli twin where it is worth its bytes. */
function describe(file) {
    const bytes = readFileSync(file);
    const brotli = brotliCompressSync(bytes, {
        params: { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_SIZE_HINT]: bytes.length },
    });
    const twin = brotli.length < 0.95 * bytes.length ? join(out, 'brotli', `${relative(page, file)}.br`) : null;
    if (twin) {
        mkdirSync(dirname(twin), { recursive: true });
        writeFileSync(twin, brotli);
    }
    const url = `/${relative(page, file)}`;
    return {
        url: url === '/index.html' ? '/' : url,
        mediaType: mediaTypes[extname(file)],
        etag: digest(bytes).slice(0, 32),
        file,
        twin,
    };
}

function cppSource(entries) {
    entries.sort((a, b) => (a.url < b.url ? -1 : 1));
    const embedded = [];
    const span = (name, file) => {
        if (!file) {
            return '{}';
        }
        embedded.push(`STIPPLE_EMBED(stipple_viewer_${name}, ${JSON.stringify(file)});`);
        return `span_of(stipple_viewer_${name}, stipple_viewer_${name}_end)`;
    };
    const rows = entries.map(({ url, mediaType, etag, file, twin }, i) => `        {"${url}", "${mediaType}", "${etag}",
         ${span(`identity_${i}`, file)},
         ${span(`brotli_${i}`, twin)}},`);
    return `// Generated by viewer/build.mjs.
#include "viewer_files.hpp"

#define STIPPLE_EMBED(name, file)                                                     \\
    __asm__(".pushsection .rodata\\n.balign 16\\n" #name ":\\n.incbin \\"" file "\\"\\n" \\
            #name "_end:\\n.byte 0\\n.popsection\\n");                                 \\
    extern "C" __attribute__((visibility("hidden"))) const std::byte name[], name##_end[]

${embedded.join('\n')}

namespace stipple::viewer {
namespace {

std::span<const std::byte> span_of(const std::byte* begin, const std::byte* end) {
    return {begin, static_cast<std::size_t>(end - begin)};
}

}  // namespace

std::span<const File> files() {
    static const File table[] = {
${rows.join('\n')}
    };
    return table;
}

}  // namespace stipple::viewer
`;
}
