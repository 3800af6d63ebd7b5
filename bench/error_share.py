#!/usr/bin/env python3
"""What the error of a result takes of a job: jobs with and without it in turn, on a running stippled.

    bench/error_share.py http://127.0.0.1:8080 igea.ply:5000 dragon_vrip.ply:10000

Prints milliseconds from the start of a job to its end, the mean of the quicker two thirds, and the share of the error.
"""

import argparse
import json
import statistics
import urllib.request
from datetime import datetime
from pathlib import Path

METHODS = ('multiphase', 'hierarchical', 'voxel', 'random')


def reply(url, body=None, media_type='application/json'):
    request = urllib.request.Request(url, data=body, headers={'Content-Type': media_type})
    with urllib.request.urlopen(request) as response:
        return json.load(response)


def seconds_of(server, request):
    job = reply(f'{server}/v1/jobs', json.dumps(request).encode())
    while job['status'] in ('accepted', 'running'):
        job = reply(server + '/v1/jobs/' + job['id'] + '?wait=20')
    if job['status'] != 'successful':
        raise SystemExit('error_share: ' + job['problem']['detail'])
    started, finished = (datetime.fromisoformat(job[end].replace('Z', '+00:00')) for end in ('started', 'finished'))
    return (finished - started).total_seconds()


def quick(seconds):
    return 1000 * statistics.mean(sorted(seconds)[: (2 * len(seconds) + 2) // 3])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('server')
    parser.add_argument('clouds', nargs='+', metavar='FILE:POINTS')
    parser.add_argument('--rounds', type=int, default=21)
    options = parser.parse_args()
    print('| cloud, points | ' + ' | '.join(f'`{method}`' for method in METHODS) + ' |\n|' + '---|' * (len(METHODS) + 1))
    for cloud in options.clouds:
        file, points = cloud.rsplit(':', 1)
        data = Path(file).read_bytes()
        cloud_id = reply(f'{options.server}/v1/clouds', data, 'application/octet-stream')['id']
        row = f'| {Path(file).stem}, {int(points):,} |'
        for method in METHODS:
            seconds = {True: [], False: []}
            for seed in range(options.rounds):  # another seed: else the server has the result already
                for error in seconds:
                    seconds[error].append(seconds_of(options.server, {
                        'type': 'simplify', 'input': cloud_id, 'method': method, 'points': int(points), 'seed': seed,
                        'error': error}))
            with_it, without = quick(seconds[True]), quick(seconds[False])
            row += f' {with_it:.1f}, {without:.1f}: {100 * (1 - without / with_it):.0f} % |'
        print(row, flush=True)


if __name__ == '__main__':
    main()
