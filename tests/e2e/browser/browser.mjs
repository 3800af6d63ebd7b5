// Headless Chromium with the page of a server, and what the page must never do.
import { accessSync, constants } from 'node:fs';
import { delimiter, join } from 'node:path';

import { decodePng } from './png.mjs';

const kFlags = ['--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
    '--disable-component-update', '--disable-sync', '--use-gl=angle', '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader'];
const kTimeoutMs = 120_000;  // software rendering on a busy machine

/** The browser's path, or null where there is none. */
export function findChromium() {
    const names = ['chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable'];
    const candidates = [process.env.CHROMIUM,
        ...names.flatMap((name) => (process.env.PATH ?? '').split(delimiter).map((folder) => join(folder, name)))];
    return candidates.find((path) => path && isExecutable(path)) ?? null;
}

function isExecutable(path) {
    try {
        accessSync(path, constants.X_OK);
        return true;
    } catch {
        return false;
    }
}

export class Browser {
    /** @param urls  of the server with the page, and of others that it may ask */
    static async launch(playwright, executablePath, ...urls) {
        const chromium = await playwright.chromium.launch({ executablePath, headless: true, args: kFlags });
        return new Browser(chromium, ...urls);
    }

    constructor(chromium, url, ...others) {
        this.chromium = chromium;
        this.url = url;
        this.urls = [url, ...others];
        this.faults = [];
        this.faultLevels = ['error', 'warning'];
        this.refusalsExpected = false;
    }

    /** A page of its own, watched for errors and for requests that leave the server. */
    async open(path = '/', { width = 1280, height = 800, colorScheme = 'dark', scale = 1 } = {}) {
        const context = await this.chromium.newContext({
            viewport: { width, height }, colorScheme, deviceScaleFactor: scale, hasTouch: width < 760, serviceWorkers: 'block',
        });
        context.setDefaultTimeout(kTimeoutMs);
        const page = await context.newPage();
        await this.watch(page);
        await page.goto(this.url + path);
        return page;
    }

    watch(page) {
        page.on('pageerror', (error) => this.faults.push(`error in the page: ${error.message}`));
        page.on('console', (message) => {
            // Chromium reports every refused request here, also those that the page shows as it should.
            const isRefusal = message.text().startsWith('Failed to load resource') && this.refusalsExpected;
            if (this.faultLevels.includes(message.type()) && !isRefusal) {
                this.faults.push(`console: ${message.text()}`);
            }
        });
        page.on('request', (request) => {
            if (!this.urls.some((url) => request.url().startsWith(`${url}/`)) && !/^(blob|data):/.test(request.url())) {
                this.faults.push(`a request left the server: ${request.url()}`);
            }
        });
        return page.addInitScript(() => {
            addEventListener('securitypolicyviolation', (event) => {
                console.error(`content security policy: ${event.violatedDirective} refused ${event.blockedURI}`);
            });
        });
    }

    /** The pixels of a part of a page. */
    async pixels(page, clip) {
        return decodePng(await page.screenshot({ clip }));
    }

    close() {
        return this.chromium.close();
    }
}
