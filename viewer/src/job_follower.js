import { getJob, isFinal, openEvents } from './api.js';

const kPollMs = 700;

/**
 * Tells `onJob` the document of a job now, whenever it changes, and a last time when it is final. Server-sent events are only
 * the nudge to ask again, so a lost event or a proxy that swallows streams costs a moment, never the result. A job that has ended
 * is asked for once.
 */
export function followJob(id, onJob, onError, signal) {
    let timer = null;
    const listening = new AbortController();
    let asking = false;
    let askAgain = false;

    async function ask() {
        if (asking) {
            askAgain = true;
            return;
        }
        asking = true;
        do {
            askAgain = false;
            try {
                const job = await getJob(id, signal);
                await onJob(job);
                if (isFinal(job)) {
                    stop();
                }
            } catch (error) {
                stop();
                if (!signal.aborted) {
                    onError(error);
                }
            }
        } while (askAgain && !signal.aborted);
        asking = false;
    }

    function stop() {
        listening.abort();
        clearInterval(timer);
        askAgain = false;
    }

    /** Asks whenever the server says anything; without its events, now and then. */
    async function listen() {
        try {
            const events = (await openEvents(id, listening.signal)).body.getReader();
            while (!(await events.read()).done) {
                ask();
            }
        } catch {
            // As when the stream ends early.
        }
        if (!listening.signal.aborted) {
            timer ??= setInterval(ask, kPollMs);
        }
    }

    signal.addEventListener('abort', stop);
    ask().then(() => {
        if (!listening.signal.aborted) {
            listen();
        }
    });
}
