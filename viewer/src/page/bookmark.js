import { addressOf, readAddress, writeAddress } from './address.js';

const kSoonMs = 100;

/** Keeps the address true to what is seen, so that it can be come back to. */
export class Bookmark {
    /** @param seen  what the address is to say (see writeAddress), or null where nothing is shown */
    constructor(seen) {
        this.seen = seen;
        this.waiting = null;
        addEventListener('pagehide', () => this.write());
    }

    /** Soon, and once for what comes together: browsers count. */
    writeSoon() {
        this.waiting ??= setTimeout(() => this.write(), kSoonMs);
    }

    write() {
        clearTimeout(this.waiting);
        this.waiting = null;
        const seen = this.seen();
        if (seen && seen.id === (readAddress()?.id ?? seen.id)) {
            writeAddress(seen);
        }
    }

    /** The address of what is shown, also where the page shows it only because it is the newest. */
    link() {
        this.write();
        return readAddress() ? location.href : addressOf(this.seen());
    }
}
