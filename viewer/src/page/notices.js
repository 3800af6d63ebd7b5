import { byId, element } from './element.js';

const kMost = 3;
const kOfferMs = 15_000;
const passing = new WeakSet();  // notices of what another result or upload leaves behind

/**
 * Shows what went wrong, in the server's words; what is returned takes it away.
 * @param action  a button with a `name` that does `act`; @param lasts  whether it stays until what went wrong is over
 */
export function showProblem(error, title = error.title ?? 'Something went wrong', { action = null, lasts = false } = {}) {
    const notice = noticeOf(element('strong', { className: 'alarm', textContent: title }), element('p', { textContent: error.message }), action);
    if (!lasts) {
        passing.add(notice);
    }
    return show(notice);
}

/** Tells why a result that an address names is not there. */
export function showMissing(error) {
    if (error.status === 404) {
        showProblem(new Error('It may have been removed, or its address is incomplete.'), 'This result does not exist');
    } else {
        showProblem(error, 'The result could not be opened');
    }
}

/** Tells of something, and where it can be acted upon, offers that by a button. It goes after a while, unless someone is about to press it. */
export function tell(title, action = null) {
    const notice = noticeOf(element('strong', { textContent: title }), action);
    const remove = show(notice);
    passing.add(notice);
    let waiting = null;
    const wait = () => { waiting = setTimeout(remove, kOfferMs); };
    const stay = () => clearTimeout(waiting);
    notice.onpointerenter = stay;
    notice.onpointerleave = wait;
    notice.addEventListener('focusin', stay);
    notice.addEventListener('focusout', wait);
    wait();
}

/** Whether there was one to close. */
export function closeNewest() {
    const newest = byId.notices.lastChild;
    if (newest) {
        removeNotice(newest);
    }
    return newest !== null;
}

/** The person goes on to something else. */
export function forgetProblems() {
    [...byId.notices.children].filter((notice) => passing.has(notice)).forEach(removeNotice);
}

/** @param content  elements; an action becomes a button */
function noticeOf(...content) {
    const close = element('button', { ariaLabel: 'Close', textContent: '✕' });
    const notice = element('div', { className: 'notice' }, element('div', {}, ...content.filter(Boolean).map((part) => {
        if (part instanceof Element) {
            return part;
        }
        const button = element('button', { className: 'action', textContent: part.name });
        button.onclick = () => {
            removeNotice(notice);
            part.act();
        };
        return button;
    })), close);
    close.onclick = () => removeNotice(notice);
    return notice;
}

/** What several requests met is told once. */
function show(notice) {
    [...byId.notices.children].filter(({ textContent }) => textContent === notice.textContent).forEach(removeNotice);
    byId.notices.append(notice);
    while (byId.notices.children.length > kMost) {
        removeNotice(byId.notices.firstChild);
    }
    return () => removeNotice(notice);
}

/** The focus goes to the next one, or to the stage. */
function removeNotice(notice) {
    const hadFocus = notice.contains(document.activeElement);
    notice.remove();
    if (hadFocus) {
        (byId.notices.querySelector('button') ?? byId.stage).focus();
    }
}
