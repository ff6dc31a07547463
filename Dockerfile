# The core:    docker build -t stlbench .
# All extras:  docker build -t stlbench --build-arg EXTRAS=all .
# A run:       docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/here" stlbench run --methods funnel,flag
FROM python:3.11-slim
ARG EXTRAS=
ENV OMP_NUM_THREADS=1 HOME=/home
COPY pyproject.toml constraints.txt README.md LICENSE /source/
COPY stlbench /source/stlbench
COPY plugins /source/plugins
COPY tasks /source/tasks
RUN pip install --no-cache-dir -c /source/constraints.txt "/source${EXTRAS:+[$EXTRAS]}" && chmod a+rwx /home
WORKDIR /here
ENTRYPOINT ["stlbench"]
