// A real stippled with a data folder of its own, on free ports.
import { spawn } from 'node:child_process';
import { createHash } from 'node:crypto';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { setTimeout as sleep } from 'node:timers/promises';

/** With `key`, a server that answers its bearer alone; `flags` are more of `stippled serve`. */
export async function startServer(binaries, { key, flags = [] } = {}) {
    const data = mkdtempSync(join(tmpdir(), 'stipple-browser-'));
    const [port, adminPort] = await freePorts(2);
    const child = spawn(join(binaries, 'stippled'),
        ['serve', '--listen', `127.0.0.1:${port}`, '--admin', `127.0.0.1:${adminPort}`, '--data', data,
            ...flags, ...(key ? ['--api-keys', keyFile(data, key)] : [])],
        { stdio: ['ignore', 'pipe', 'pipe'] });
    let log = '';
    child.stdout.on('data', (text) => { log += text; });
    child.stderr.on('data', (text) => { log += text; });
    const ended = new Promise((resolve) => child.on('exit', resolve).on('error', resolve));
    const server = {
        url: `http://127.0.0.1:${port}`,
        get log() { return log; },
        async stop() {
            child.kill('SIGTERM');
            await ended;
            rmSync(data, { recursive: true, force: true });
        },
    };
    try {
        await ready(`http://127.0.0.1:${adminPort}/readyz`, child);
    } catch (error) {
        await server.stop();
        throw new Error(`${error.message}\n${log}`);
    }
    return server;
}

function keyFile(folder, key) {
    const file = join(folder, 'keys.json');
    const grant = { tenant: 'ada', key_sha256: createHash('sha256').update(key).digest('hex'), scopes: ['read', 'submit'] };
    writeFileSync(file, JSON.stringify([grant]));
    return file;
}

async function ready(url, child) {
    for (let tries = 0; tries < 300; tries += 1) {
        if (child.exitCode !== null) {
            throw new Error(`stippled ended at once with ${child.exitCode}`);
        }
        if ((await fetch(url).catch(() => null))?.ok) {
            return;
        }
        await sleep(100);
    }
    throw new Error('stippled was not ready within 30 s');
}

/** Held together until all are known, so that they differ. */
async function freePorts(count) {
    const listeners = await Promise.all(Array.from({ length: count }, () => new Promise((resolve) => {
        const listener = createServer().listen(0, '127.0.0.1', () => resolve(listener));
    })));
    const ports = listeners.map((listener) => listener.address().port);
    await Promise.all(listeners.map((listener) => new Promise((resolve) => { listener.close(resolve); })));
    return ports;
}
