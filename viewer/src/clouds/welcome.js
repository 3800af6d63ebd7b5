import { byId, setHidden } from '../page/element.js';
import { ammonite } from './ammonite.js';

const kInvitation = 'Drop a point cloud here';
const kInvitationByTouch = 'Choose a point cloud';
const kNote = 'PLY or Draco. It becomes a pyramid of levels that streams in, coarse to fine.';

/** In the middle of an empty page: what to do, or what is on its way. */
export class Welcome {
    /** @param onFiles  told a file to try the page with */
    constructor({ onFiles }) {
        byId.try.onclick = () => onFiles([new File([ammonite()], 'ammonite.ply')]);
        this.invite();
    }

    setShown(isShown) {
        byId.welcome.hidden = !isShown;
    }

    invite() {
        this.tell(matchMedia('(pointer: coarse)').matches ? kInvitationByTouch : kInvitation, kNote);
        setHidden(byId.try, false);
    }

    /** @param name  of the file that is being sent; @param note  how far it is */
    showProgress({ name, note }) {
        this.tell(`Sending ${name}`, note);
        setHidden(byId.try, true);
    }

    tell(title, note) {
        byId['welcome-title'].textContent = title;
        byId['welcome-note'].textContent = note;
    }
}
