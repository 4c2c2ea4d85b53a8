#
# ROS 2 with this package:  docker build -t phd_jdtc_ros .
# docs/container.md says how it is used. The packages are those of package.xml, which a test compares.
ARG DISTRO=jazzy

FROM ros:${DISTRO}-ros-base AS dependencies
ARG DISTRO
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
# All of package.xml but rviz2, which needs a screen.
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        python3-aiohttp \
        python3-colcon-common-extensions \
        python3-matplotlib \
        python3-numpy \
        python3-pip \
        python3-pyproj \
        python3-rich \
        python3-scipy \
        python3-shapely \
        python3-yaml \
        ros-${DISTRO}-ament-index-python \
        ros-${DISTRO}-builtin-interfaces \
        ros-${DISTRO}-diagnostic-msgs \
        ros-${DISTRO}-geometry-msgs \
        ros-${DISTRO}-launch \
        ros-${DISTRO}-launch-ros \
        ros-${DISTRO}-lifecycle-msgs \
        ros-${DISTRO}-nav-msgs \
        ros-${DISTRO}-rcl-interfaces \
        ros-${DISTRO}-rclpy \
        ros-${DISTRO}-ros2launch \
        ros-${DISTRO}-rosgraph-msgs \
        ros-${DISTRO}-sensor-msgs \
        ros-${DISTRO}-std-msgs \
        ros-${DISTRO}-std-srvs \
        ros-${DISTRO}-tf2-msgs \
        ros-${DISTRO}-visualization-msgs \
    && rm -rf /var/lib/apt/lists/*
# What has no package in Ubuntu: bags, compilation, the report's page, ASTERIX. The messages that ROS has compiled
# need the numpy that Ubuntu has.
RUN python3 -c 'import numpy, scipy; print(f"numpy=={numpy.__version__}\nscipy=={scipy.__version__}")' \
        >/tmp/constraints.txt \
    && pip install --break-system-packages --no-cache-dir -c /tmp/constraints.txt \
        libasterix mcap-ros2-support numba plotly \
    && rm /tmp/constraints.txt

# What .devcontainer opens: the checkout is mounted, and `make` installs into its .venv.
FROM dependencies AS development
ARG DISTRO
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        git \
        iproute2 \
        make \
        python3-hypothesis \
        python3-pytest \
        python3-pytest-timeout \
        python3-venv \
        ros-${DISTRO}-ament-flake8 \
        ros-${DISTRO}-ament-pep257 \
        ros-${DISTRO}-launch-testing \
        ros-${DISTRO}-shape-msgs \
        ros-${DISTRO}-unique-identifier-msgs \
    && rm -rf /var/lib/apt/lists/* \
    && echo "source /opt/ros/${DISTRO}/setup.bash" >>/etc/bash.bashrc
USER ubuntu

FROM dependencies AS runtime
ARG DISTRO
WORKDIR /workspace
COPY . src/phd_jdtc_ros
RUN source /opt/ros/${DISTRO}/setup.bash \
    && colcon build --packages-select phd_jdtc_ros \
    && rm -rf build log src \
    && install -d -o ubuntu -g ubuntu /data
USER ubuntu
# Where files come in and go out:  docker run -v "$PWD:/data" ...
WORKDIR /data
ENTRYPOINT ["/bin/bash", "-c", "source /workspace/install/setup.bash && exec \"$@\"", "--"]
CMD ["ros2", "run", "phd_jdtc_ros", "demo", "--out", "/tmp/demo"]
