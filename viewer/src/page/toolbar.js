import { byId } from './element.js';

const kOfPicture = ['compare', 'fit', 'rotate', 'share'];

/** The buttons at the edge of the stage; what the cards behind some of them do is up to these. */
export class Toolbar {
    /** @param onFit  asked for the whole cloud; @param onRotate  told whether it is to turn */
    constructor({ onFit, onRotate }) {
        byId.fit.onclick = onFit;
        byId.rotate.onclick = () => {
            const isOn = byId.rotate.ariaPressed !== 'true';
            byId.rotate.ariaPressed = String(isOn);
            onRotate(isOn);
        };
        byId.help.onclick = () => byId['help-dialog'].showModal();
    }

    /** What can be done to a picture, where there is one. */
    setHasPicture(hasPicture) {
        kOfPicture.forEach((id) => { byId[id].disabled = !hasPicture; });
    }
}
