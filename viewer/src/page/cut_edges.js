/** Marks an element that scrolls as `cut-above`, `cut-below` and `cut-right` where there is more than is seen: its edges fade there. */
export function fadeWhereCut(scrolled) {
    const show = () => {
        const { scrollTop, clientHeight, scrollHeight, scrollLeft, clientWidth, scrollWidth } = scrolled;
        scrolled.classList.toggle('cut-above', scrollTop > 1);
        scrolled.classList.toggle('cut-below', scrollTop + clientHeight < scrollHeight - 1);
        scrolled.classList.toggle('cut-right', scrollLeft + clientWidth < scrollWidth - 1);
    };
    scrolled.addEventListener('scroll', show, { passive: true });
    new ResizeObserver(show).observe(scrolled);
    new MutationObserver(show).observe(scrolled, { childList: true, subtree: true, characterData: true });
}
