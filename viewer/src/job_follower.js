import { getJob, isFinal } from './api.js';

const kPollMs = 700;
const kEventTypes = ['status', 'progress', 'source', 'level'];

/**
 * Tells `onJob` the document of a job now, whenever it changes, and a last time when it is final. Server-sent events are only
 * the nudge to ask again, so a lost event or a proxy that swallows streams costs a moment, never the result.
 */
export function followJob(id, onJob, onError, signal) {
    let events = null;
    let timer = null;
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
        events?.close();
        clearInterval(timer);
        askAgain = false;
    }

    function poll() {
        events.close();
        timer ??= setInterval(ask, kPollMs);
    }

    signal.addEventListener('abort', stop);
    events = new EventSource(`/v1/jobs/${id}/events`);
    for (const type of kEventTypes) {
        events.addEventListener(type, ask);
    }
    events.addEventListener('error', poll);
    ask();
}
