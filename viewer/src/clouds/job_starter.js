import { isFinal, mayPass, removeCloud, startEvaluation, startJob } from '../api/api.js';
import { fileNameOf } from '../api/download.js';
import { followJob } from '../api/job_follower.js';
import { uploadCloud } from '../api/upload.js';
import { kMostWhole } from '../loading/level_plan.js';
import * as format from '../page/format.js';
import { showProblem } from '../page/notices.js';
import { inputOf } from './library.js';

/** Bytes of a point in a small file of each kind: a pyramid with large levels needs tiles, which take the server longer to make. */
const kFewestBytes = { ply: 12, drc: 1.5, stpc: 1.5 };

const isLarge = ({ format: kind, bytes }) => bytes > kMostWhole * kFewestBytes[kind];

/** How the pyramid of a cloud is best made: what is small is there within a second by the method of less error, too. */
export const pyramidFor = (cloud) => (isLarge(cloud) ? { tiles: { attributes: true } } : { method: 'multiphase' });

/** Starts jobs: each once where it is asked for again before it is there, as by a double click. */
export class JobStarter {
    /**
     * @param onJob  told a job that was started; @param onMap  told one that measures where a result is how far from its input
     * @param onCloudsChanged  told when a cloud that was sent to be measured is gone
     * @param mapOf  a job that measures, or did, how far a candidate is from a reference, if there is one
     */
    constructor({ onJob, onMap, onCloudsChanged, mapOf }) {
        Object.assign(this, { onJob, onMap, onCloudsChanged, mapOf });
        this.pending = new Map();  // what was asked of the server, by its key, and is not there yet
    }

    /** Rejects where the server does. @param fields  of the job beside its type and the cloud that it is about */
    start(type, cloudId, fields) {
        return this.once(JSON.stringify([type, cloudId, fields]), async () => {
            this.onJob(await startJob(type, cloudId, fields));
        });
    }

    /** A pyramid to look at, in the formats that the page shows. */
    startPyramid(cloud) {
        return this.attempt('pyramid', cloud.id, { ...pyramidFor(cloud), formats: isLarge(cloud) ? ['drc', 'glb'] : ['drc'] });
    }

    /** A simplification to so many points, by the method of a curve. */
    startAsCurve({ request: { type, input, count, points: measured, ...ofMethod } }, points) {
        return this.attempt('simplify', input, { ...ofMethod, points, format: 'drc' });
    }

    /** The same job once more, as it was asked for. */
    startAgain({ type, request }) {
        const { type: sameType, input, reference, candidate, ...fields } = request;
        return this.attempt(type, inputOf({ request }), fields);
    }

    /** As `start`, but a refusal is shown, and one that may pass can be tried again. */
    attempt(type, cloudId, fields) {
        const again = { action: { name: 'Try again', act: () => this.attempt(type, cloudId, fields) } };
        return this.start(type, cloudId, fields).catch((error) => showProblem(error, 'The job could not be started', mayPass(error) ? again : {}));
    }

    /** Where the surface that a session shows is how far from that of the input. */
    startMap({ id, job, shown }) {
        return this.once(`map ${id} ${shown.level}`, async () => {
            try {
                this.onMap(await this.measure(inputOf(job), shown, `${format.points(shown.points)}, ${job.request.method ?? job.type}`));
            } catch (error) {
                showProblem(error, 'The error could not be measured');
            }
        });
    }

    /** A level without a file becomes a cloud of its own, for as long as it is measured. */
    async measure(reference, level, label) {
        const { file, ply } = level;
        if (file) {
            return this.mapOf(reference, file.sha256) ?? startEvaluation(reference, file.sha256, label);
        }
        const { id, isNew } = await uploadCloud(new File([await ply()], fileNameOf(level, 'ply')));
        const remove = () => isNew && removeCloud(id).then(() => this.onCloudsChanged()).catch(showProblem);
        try {
            const map = await startEvaluation(reference, id, label);
            const removeOnceOver = (job) => isFinal(job) && remove();  // until then it is needed
            followJob(map.id, { onJob: removeOnceOver, onLost: () => {}, onError: remove, signal: new AbortController().signal });
            return map;
        } catch (error) {
            remove();
            throw error;
        }
    }

    once(key, act) {
        if (!this.pending.has(key)) {
            this.pending.set(key, act().finally(() => this.pending.delete(key)));
        }
        return this.pending.get(key);
    }
}
