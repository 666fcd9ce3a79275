#!/bin/bash
# Ends what start_slurm.sh FOLDER started.
folder=$(realpath "$1")
scancel --me --quiet || true
for part in slurmd.pid slurmctld.pid munge/pid; do
  if [ -f "$folder/$part" ]; then kill "$(cat "$folder/$part")" || true; fi
done
rm -f /etc/slurm/slurm.conf /etc/slurm/gres.conf
rm -rf "$(dirname "$(cat "$folder/socket")")"
