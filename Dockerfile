# A worker, or one share of a fleet, without a network: `make wheels`, then `docker build -t cafim .`
#   docker run -v /data:/data cafim diagnose --fleet /data/fleet --out /data/out --shard 3/16
#   docker run -v /data:/data --entrypoint dask cafim worker tcp://10.0.0.1:8786 --nthreads 1
FROM python:3.11-slim
ENV OMP_NUM_THREADS=1 MPLBACKEND=Agg
COPY wheels /wheels
RUN pip install --no-cache-dir --no-index --find-links /wheels 'drake_cafim[cluster]' && rm -rf /wheels
ENTRYPOINT ["cafim"]
