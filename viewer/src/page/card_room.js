import { byId } from './element.js';
import { isPhone } from './sheet.js';

const kLegendGap = 10;
const kFlat = 480;

/** The insets of the page that the cards leave free, in pixels. */
export function roomBesideCards() {
    const library = byId.library.getBoundingClientRect();
    const dock = byId.dock.getBoundingClientRect();
    const hud = byId.hud.hidden ? null : byId.hud.getBoundingClientRect();
    const legend = byId.legend.offsetHeight > 0 ? byId.legend.offsetHeight + kLegendGap : 0;
    const card = [byId['look-card'], byId['share-card']].find(({ hidden }) => !hidden)?.getBoundingClientRect();
    const compared = [byId['left-label'], byId['compare-with']].map((part) => part.getBoundingClientRect().bottom).find((bottom) => bottom > 0) ?? 0;
    const tools = byId.tools.getBoundingClientRect();  // of a phone: at its right where it lies on its side
    const isFlat = innerHeight <= kFlat;
    return isPhone()
        ? { left: 0, right: isFlat ? innerWidth - (card ?? tools).left : 0, top: compared || (isFlat ? 0 : tools.bottom), bottom: innerHeight - (hud ? hud.top - byId.grip.offsetHeight : dock.top) + legend }
        : { left: library.right, right: card ? innerWidth - card.left : 0, top: compared, bottom: hud ? innerHeight - hud.top + legend : 0 };
}

/** Calls `act` whenever the page or a card has another size. */
export function watchCards(act) {
    addEventListener('resize', act);
    const cards = new ResizeObserver(act);
    [byId.hud, byId.legend, byId['look-card'], byId['share-card'], byId['left-label'], byId['compare-with']].forEach((card) => cards.observe(card));
}
