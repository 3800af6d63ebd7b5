#!/usr/bin/env python3
"""Bytes to an error: a progressive stream beside the ladder of a pyramid's tiles.

    bench/stream_and_ladder.py CLOUD.ply --method hierarchical

For each level of the pyramid: the mean distance of the cloud's surface from that of its decoded tiles (`stipple evaluate`), the bytes of
all tiles down to it, each with brotli 11, and of the shortest prefix of the stream with that error: whole batches, with a power law between
them. The last level is the whole cloud, for which all of the stream counts. Needs `stipple` and `brotli` in PATH.
"""
import argparse
import json
import math
import subprocess
import tempfile
from pathlib import Path


def stipple(*words):
    command = ['stipple', *map(str, words), '--quiet', '--json', '-']
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)


def mean_error(cloud, candidate):
    return stipple('evaluate', cloud, candidate)['forward']['mean']


def packed_bytes(path):
    return len(subprocess.run(['brotli', '-q', '11', '-c', path], check=True, capture_output=True).stdout)


def stream_bytes(error, batches, error_of):
    """The first batch that ends below the error is found by halving: errors fall."""
    low, high = 0, len(batches) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if error_of(middle) <= error else (middle + 1, high)
    if low == 0:
        return batches[0]['bytes']
    before, after = error_of(low - 1), error_of(low)
    share = math.log(before / error) / math.log(before / after)
    return batches[low - 1]['bytes'] * (batches[low]['bytes'] / batches[low - 1]['bytes']) ** share


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('cloud', type=Path)
    parser.add_argument('--method', default='hierarchical')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, part = Path(name) / 'levels', Path(name) / 'part.ply'
        stipple('pyramid', options.cloud, folder, '--method', options.method, '--formats', 'glb')
        stream = Path(name) / 'all.stpc'
        stipple('convert', options.cloud, stream)
        batches = stipple('inspect', stream)['batches']
        known = {}

        def error_of(batch):
            if batch not in known:
                stipple('convert', stream, part, '--points', batches[batch]['points'])
                known[batch] = mean_error(options.cloud, part)
            return known[batch]

        manifest = json.loads((folder / 'manifest.json').read_text())
        diagonal = math.dist(*manifest['source']['bounds'].values())
        print('| points | mean error | ladder, bytes | stream, bytes | of the ladder |\n|---|---|---|---|---|')
        ladder = 0
        for level in manifest['levels']:
            ladder += sum(packed_bytes(folder / file['href']) for file in level['files'])
            if level is manifest['levels'][-1]:
                error, bytes_ = None, batches[-1]['bytes']
            else:
                stipple('slice', folder, part, '--points', level['points'])
                error = mean_error(options.cloud, part)
                bytes_ = stream_bytes(error, batches, error_of)
            told = f'{100 * error / diagonal:.4f} %' if error else ''
            print(f"| {level['points']:,} | {told} | {ladder:,} | {bytes_:,.0f} | {bytes_ / ladder:.2f} × |", flush=True)


if __name__ == '__main__':
    main()
