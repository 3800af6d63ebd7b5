import { getManifest } from '../api/api.js';
import * as format from '../page/format.js';
import { pyramidFor } from './job_starter.js';
import { inputOf, keptOf, nameOf, summaryOf, titleOf } from './library.js';

const kMostResults = 12;  // the newest
/** Jobs with one level. Those of pyramids are too many to choose among, but for what is shown. */
const kWithCloud = ['simplify', 'upsample', 'analyze'];

/** What a job about a cloud is for, as JobForm asks it. @param session  of the result that is shown, or null */
export async function subjectOf(cloud, { clouds, jobs }, session) {
    const isOfIt = (job) => job.status === 'successful' && kWithCloud.includes(job.type) && inputOf(job) === cloud.id && job.id !== session?.id;
    const results = await Promise.all(jobs.filter(isOfIt).slice(0, kMostResults).map((job) => fileOf(job, cloud)));
    const others = [...levelsOf(session, cloud), ...results.flat(), ...clouds.map((other) => ({ id: other.id, name: nameOf(other) }))];
    return {
        cloud: cloud.id, name: nameOf(cloud), points: cloud.points && keptOf(cloud).points, attributes: attributesOf(cloud), presets: { pyramid: pyramidFor(cloud) },
        others: others.filter(({ id }, i) => id !== cloud.id && others.findIndex((other) => other.id === id) === i),
    };
}

/** Those beside the colours and normals, where they are known. */
const attributesOf = ({ attributes = [] }) => attributes.map(({ name }) => name).filter((name) => name !== 'normal' && name !== 'color');

/** The levels of what is shown, if it was made from the cloud. */
function levelsOf(session, cloud) {
    const isOfIt = session?.job && session.job.type !== 'evaluate' && inputOf(session.job) === cloud.id;
    return (isOfIt ? session.loader.levels : []).filter(({ file }) => file).map(({ file, points }) =>
        ({ id: file.sha256, name: `${titleOf(session.job)}, ${format.compactPoints(points)}` }));
}

/** The file of a result; none where it is gone meanwhile, or cannot be asked for: it is one of several to choose among. */
async function fileOf(job, cloud) {
    try {
        const { levels: [{ files }] } = await getManifest(job);
        return [{ id: files[0].sha256, name: `${titleOf(job)}, ${summaryOf(job, cloud)}` }];
    } catch {
        return [];
    }
}
