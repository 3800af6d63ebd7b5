import { element } from './element.js';

const kStayMs = 15_000;

/** Shows what went wrong, in the server's words, until it is read. What several requests met is told once. */
export function showProblem(error, title = error.title ?? 'Something went wrong') {
    const notices = document.getElementById('notices');
    const close = element('button', { ariaLabel: 'Close', textContent: '✕' });
    const notice = element('div', { className: 'notice' },
        element('div', {}, element('strong', { textContent: title }), element('p', { textContent: error.message })), close);
    [...notices.children].filter(({ textContent }) => textContent === notice.textContent).forEach((same) => same.remove());
    close.onclick = () => notice.remove();
    setTimeout(() => notice.remove(), kStayMs);
    notices.append(notice);
    while (notices.children.length > 3) {
        notices.firstChild.remove();
    }
}
