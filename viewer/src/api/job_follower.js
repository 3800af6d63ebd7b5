import { getJob, isFinal, openEvents, pause, persist } from './api.js';

const kPauseMs = 700;

/**
 * Tells `onJob` the document of a job now, whenever it changes, and a last time when it is final. Server-sent events are only
 * the nudge to ask again, so a lost event or a proxy that swallows streams costs a moment, never the result; a stream that was
 * cut is opened anew from its start. A job that has ended is asked for once.
 *
 * While the server cannot be reached it is asked again and again: `onLost` is told (see `persist`), and `onJob` when it is back.
 * `onError` is told why there is nothing more to follow.
 */
export function followJob(id, { onJob, onLost, onError, signal }) {
    const listening = new AbortController();
    let asking = null;
    let askAgain = false;

    /** One request at a time; what is asked for meanwhile is asked for after it. */
    function ask() {
        askAgain = asking !== null;
        asking ??= askNow().finally(() => { asking = null; });
        return asking;
    }

    async function askNow() {
        try {
            do {
                askAgain = false;
                const job = await persist(async () => {
                    const news = await getJob(id, signal);
                    await onJob(news);
                    return news;
                }, { signal, onLost });
                if (isFinal(job)) {
                    listening.abort();
                }
            } while (askAgain && !listening.signal.aborted);
        } catch (error) {
            listening.abort();
            if (!signal.aborted) {
                onError(error);
            }
        }
    }

    /** Asks whenever the server says anything, until it ends the stream. */
    async function listen() {
        try {
            const events = (await openEvents(id, listening.signal)).body.getReader();
            while (!(await events.read()).done) {
                ask();
            }
        } catch {
            // As when the stream ends early.
        }
    }

    async function follow() {
        await ask();
        while (!listening.signal.aborted) {
            await listen();
            await pause(kPauseMs);
            if (!listening.signal.aborted) {
                await ask();
            }
        }
    }

    signal.addEventListener('abort', () => listening.abort());
    follow();
}
