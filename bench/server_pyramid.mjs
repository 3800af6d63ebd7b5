/** Uploads a file to a server and waits for its pyramid: its `id` and its manifest. */
export async function pyramidOf(url, file, parameters = {}) {
    const post = async (path, body, type) =>
        (await fetch(url + path, { method: 'POST', headers: { 'Content-Type': type }, body })).json();
    const { id: input } = await post('/v1/clouds', file, 'application/octet-stream');
    const { id } = await post('/v1/jobs', JSON.stringify({ type: 'pyramid', input, ...parameters }), 'application/json');
    for (let job = {}; job.status !== 'successful';) {
        job = await (await fetch(`${url}/v1/jobs/${id}?wait=20`)).json();
        if (!['accepted', 'running', 'successful'].includes(job.status)) {
            throw new Error(`no pyramid: ${job.message ?? job.detail}`);
        }
    }
    return { id, manifest: await (await fetch(`${url}/v1/jobs/${id}/results`)).json() };
}
