#!/usr/bin/env bash
# Train detectors like the two that ship, from data to evaluated models in out/training. A stopped run continues.
# Needs `pip install pavetwin[train,detect,evaluate]` and, for `photographs`, the images that recipes/photographs.yaml
# names. A graphics card learns from hundreds of views per second, two processor cores from seven.
set -euo pipefail
cd "$(dirname "$0")/.."
runs=out/training
shared=(--batch 64 --workers 2 --set rate=0.0015 --set upside_down=0.5 --set warmup_epochs=0.3 --set classifier_epochs=0
    --set ema_decay=0.999 --set ema_steps=500)

pavetwin data build recipes/rendered.yaml -o datasets/rendered
pavetwin train datasets/rendered/synthetic -o $runs/rendered --image 640 --native --epochs 20 \
    --set mosaic=0.3 --set mosaic_off=4 "${shared[@]}"
pavetwin export $runs/rendered -o $runs/rendered.onnx --half --licence Apache-2.0
pavetwin evaluate $runs/rendered.onnx datasets/rendered/synthetic -o $runs/rendered-report --against rendered

pavetwin data build recipes/photographs.yaml -o datasets/photographs
pavetwin train datasets/photographs/export datasets/rendered/synthetic -o $runs/photographs --start rendered \
    --order synthetic-real --set skip_first=true --image 512 --native --epochs 6 \
    --set repeats=8 --set replay=0.3 --set mosaic=0.5 --set mosaic_off=1 "${shared[@]}"
pavetwin export $runs/photographs -o $runs/photographs.onnx --half \
    --licence "Apache-2.0; trained on photographs of RDD2022 (Arya et al. 2022), whose terms are stated there: cite it"
pavetwin evaluate $runs/photographs.onnx datasets/photographs/export -o $runs/photographs-report --against photographs
