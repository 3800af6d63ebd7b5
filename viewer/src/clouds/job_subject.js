import * as format from '../page/format.js';
import { inputOf, nameOf, titleOf } from './library.js';

/** What a job about a cloud is for, as JobForm asks it. @param clouds  that there are; @param session  of the result that is shown, or null */
export const subjectOf = (cloud, { clouds, session }) => ({
    cloud: cloud.id, name: nameOf(cloud), attributes: attributesOf(cloud), others: othersThan(cloud, clouds, session),
});

/** Those beside the colours and normals, where they are known. */
const attributesOf = ({ attributes = [] }) => attributes.map(({ name }) => name).filter((name) => name !== 'normal' && name !== 'color');

/** What a cloud can be compared with: other clouds, and levels of what is shown, if it was made from it. */
function othersThan({ id }, clouds, session) {
    const isOfIt = session?.job && session.job.type !== 'evaluate' && inputOf(session.job) === id;
    const levels = (isOfIt ? session.loader.levels : []).filter(({ file }) => file).map(({ file, points }) =>
        ({ id: file.sha256, name: `${titleOf(session.job)}, ${format.compactPoints(points)}` }));
    return [...levels, ...clouds.map((cloud) => ({ id: cloud.id, name: nameOf(cloud) }))].filter((other) => other.id !== id);
}
