// Pyramids put into a bucket: another store that speaks S3 (s3rver) keeps them, and another's signatures (aws4) are the
// ones that it takes.
//
//     node bucket_test.mjs --bin build/dev/bin --modules node_modules
import assert from 'node:assert/strict';
import { execFile, execFileSync } from 'node:child_process';
import { mkdtempSync, readdirSync, readFileSync, rmSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { parseArgs } from 'node:util';

const { values: options } = parseArgs({ options: { bin: { type: 'string' }, modules: { type: 'string' } } });
const from = createRequire(join(resolve(options.modules), 'from.js'));
const S3rver = from('s3rver'), aws4 = from('aws4');
const program = join(options.bin, 'stipple');
const folder = mkdtempSync(join(tmpdir(), 'stipple-bucket-'));
const keys = { accessKeyId: 'S3RVER', secretAccessKey: 'S3RVER' };

/** What stands in `Authorization` of a request, made anew from what it signs. */
function signed({ method, url, headers }) {
    const said = headers.authorization.match(/Credential=[^/]+\/(\d+)\/([^/]+)\/s3\/aws4_request.*SignedHeaders=([^,]+)/);
    const [, , region, names] = said;
    const only = Object.fromEntries(names.split(';').map((name) => [name, headers[name]]));
    return aws4.sign({ method, path: url, host: headers.host, headers: only, service: 's3', region }, keys).headers.Authorization;
}

/** Two runs take not the same time. */
const withoutCost = (manifest) => JSON.parse(manifest, (key, value) => (key === 'cost' ? undefined : value));

const signature = (authorization) => authorization.match(/Signature=([0-9a-f]{64})/)[1];

/** A store, with a list of what it was asked; `unwell`: so many requests to put it answers with 503 first. */
async function startStore() {
    const store = new S3rver({ address: '127.0.0.1', port: 0, silent: true, directory: join(folder, 'store'), configureBuckets: [{ name: 'scans' }] });
    const asked = [];
    const state = { asked, unwell: 0, token: undefined };
    const answer = (context, status, code) => {
        context.status = status;
        context.type = 'application/xml';
        context.body = `<Error><Code>${code}</Code><Message>by the test</Message></Error>`;
    };
    store.middleware.unshift(async (context, next) => {
        const { method, headers } = context.req;
        if (!headers.authorization) return next();
        asked.push({ method, path: decodeURIComponent(context.req.url.slice('/scans/'.length)), headers });
        if (signature(headers.authorization) !== signature(signed(context.req))) return answer(context, 403, 'SignatureDoesNotMatch');
        state.token = headers['x-amz-security-token'];
        if (method === 'PUT' && state.unwell-- > 0) return answer(context, 503, 'SlowDown');
        delete headers.authorization;  // the store itself does not know how they are made
        return next();
    });
    const { port } = await store.run();
    return { ...state, state, url: `http://127.0.0.1:${port}`, stop: () => store.close() };
}

const store = await startStore();

const environment = { PATH: process.env.PATH, AWS_ACCESS_KEY_ID: keys.accessKeyId, AWS_SECRET_ACCESS_KEY: keys.secretAccessKey, AWS_ENDPOINT_URL: store.url };

/** Runs `stipple pyramid`, the store going on meanwhile. */
const pyramid = (args, changes = {}) => new Promise((done) => {
    store.asked.length = 0;
    execFile(program, ['pyramid', join(folder, 'in.ply'), ...args, '--quiet'], { env: { ...environment, ...changes } },
        (error, out, err) => done({ code: error ? error.code : 0, err }));
});

try {
    execFileSync(program, ['synthesize', join(folder, 'in.ply'), '--points', '20000', '--quiet']);

    // What is put is what would be written; the manifest last; tiles for ever.
    for (const prefix of ['', 'a b/ü+%/levels']) {
        const put = await pyramid([`s3://scans/${prefix}`, '--levels', '500,8000', '--tile-points', '1000']);
        assert.deepEqual(put, { code: 0, err: '' });
        const written = await pyramid([join(folder, 'levels'), '--levels', '500,8000', '--tile-points', '1000']);
        assert.deepEqual(written, { code: 0, err: '' });
        const names = readdirSync(join(folder, 'levels'));
        assert.ok(names.length > 10);
        for (const name of names) {
            const path = [...prefix.split('/').filter(Boolean), name].map(encodeURIComponent).join('/');
            const got = await fetch(`${store.url}/scans/${path}`);
            assert.equal(got.status, 200, name);
            const [there, here] = [Buffer.from(await got.arrayBuffer()), readFileSync(join(folder, 'levels', name))];
            if (name === 'manifest.json') assert.deepEqual(withoutCost(there), withoutCost(here));
            else assert.deepEqual(there, here, name);
            const tile = /^[0-9a-f]{64}\.glb$/.test(name);
            assert.equal(got.headers.get('cache-control'), tile ? 'public, max-age=31536000, immutable' : 'no-cache', name);
            const type = { glb: 'model/gltf-binary', json: 'application/json', ply: 'model/ply', drc: 'model/vnd.google.draco' };
            assert.equal(got.headers.get('content-type'), type[name.split('.').at(-1)], name);
        }
    }
    await pyramid(['s3://scans/order', '--levels', '500,8000']);
    const puts = store.asked.filter(({ method }) => method === 'PUT').map(({ path }) => path);
    assert.equal(puts.at(-1), 'order/manifest.json');
    assert.equal(puts.filter((path) => path === 'order/manifest.json').length, 1);
    assert.ok(puts.at(-2).endsWith('.json') && !puts.slice(0, -2).some((path) => path.endsWith('tileset.json')), 'a file comes after those that it names');

    // A folder of Potree 2, too; and keys that expire.
    assert.deepEqual(await pyramid(['s3://scans/potree', '--layout', 'potree'], { AWS_SESSION_TOKEN: 'for/an+hour==' }), { code: 0, err: '' });
    assert.deepEqual(store.asked.filter(({ method }) => method === 'PUT').map(({ path }) => path).sort(),
        ['potree/hierarchy.bin', 'potree/metadata.json', 'potree/octree.bin']);
    assert.ok(store.asked.every(({ headers }) => headers['x-amz-security-token'] === 'for/an+hour=='));

    // What passes is tried anew.
    store.state.unwell = 2;
    assert.deepEqual(await pyramid(['s3://scans/again', '--levels', '500', '--formats', 'ply']), { code: 0, err: '' });
    assert.equal((await fetch(`${store.url}/scans/again/manifest.json`)).status, 200);

    // What is wrong is said before the work is done, and in the end nothing is there.
    const refused = async (changes, address, said) => {
        const { code, err } = await pyramid([address, '--levels', '500'], changes);
        assert.notEqual(code, 0, said);
        assert.ok(err.includes(said), err);
        assert.ok(store.asked.every(({ method }) => method !== 'PUT'));
    };
    await refused({ AWS_SECRET_ACCESS_KEY: 'another' }, 's3://scans/x', 'SignatureDoesNotMatch: by the test');
    await refused({ AWS_SECRET_ACCESS_KEY: '' }, 's3://scans/x', 'AWS_SECRET_ACCESS_KEY is not set');
    await refused({}, 's3://nowhere/x', 'NoSuchBucket');
    await refused({}, 's3://UPPER/x', 'expected s3://BUCKET/PREFIX');
    await refused({ AWS_ENDPOINT_URL: 'http://127.0.0.1:9' }, 's3://scans/x', '127.0.0.1');
    await refused({ AWS_ENDPOINT_URL: 'ftp://127.0.0.1' }, 's3://scans/x', 'expected https://HOST');

    // A store that stays unwell is told of; the manifest is not there.
    store.state.unwell = 1000;
    const { code, err } = await pyramid(['s3://scans/unwell', '--levels', '500', '--formats', 'ply']);
    assert.notEqual(code, 0);
    assert.match(err, /level-0\.ply.*503.*SlowDown/);
    assert.equal((await fetch(`${store.url}/scans/unwell/manifest.json`)).status, 404);
} finally {
    await store.stop();
    rmSync(folder, { recursive: true, force: true });
}
