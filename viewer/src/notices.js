import { byId, element } from './element.js';

const kMost = 3;

/** Shows what went wrong, in the server's words, until it is read; what is returned takes it away. */
export function showProblem(error, title = error.title ?? 'Something went wrong') {
    return show(element('strong', { className: 'alarm', textContent: title }), element('p', { textContent: error.message }));
}

/** Tells of something that can be acted upon, by a button with a name. */
export function offer(title, name, act) {
    const button = element('button', { className: 'action', textContent: name });
    const remove = show(element('strong', { textContent: title }), button);
    button.onclick = () => {
        remove();
        act();
    };
}

/** What several requests met is told once. */
function show(...content) {
    const close = element('button', { ariaLabel: 'Close', textContent: '✕' });
    const notice = element('div', { className: 'notice' }, element('div', {}, ...content), close);
    const remove = () => removeNotice(notice);
    close.onclick = remove;
    [...byId.notices.children].filter(({ textContent }) => textContent === notice.textContent).forEach(removeNotice);
    byId.notices.append(notice);
    while (byId.notices.children.length > kMost) {
        removeNotice(byId.notices.firstChild);
    }
    return remove;
}

/** The focus goes to the next one, or to the stage. */
function removeNotice(notice) {
    const hadFocus = notice.contains(document.activeElement);
    notice.remove();
    if (hadFocus) {
        (byId.notices.querySelector('button') ?? byId.stage).focus();
    }
}
