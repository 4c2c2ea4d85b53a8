#
# ROS 2 Jazzy with this package:  docker build -t phd_jdtc_ros .
# docs/container.md says how it is used. The packages are those of package.xml, which a test compares.

FROM ros:jazzy-ros-base AS dependencies
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
        ros-jazzy-ament-index-python \
        ros-jazzy-builtin-interfaces \
        ros-jazzy-diagnostic-msgs \
        ros-jazzy-geometry-msgs \
        ros-jazzy-launch \
        ros-jazzy-launch-ros \
        ros-jazzy-lifecycle-msgs \
        ros-jazzy-nav-msgs \
        ros-jazzy-rcl-interfaces \
        ros-jazzy-rclpy \
        ros-jazzy-ros2launch \
        ros-jazzy-rosgraph-msgs \
        ros-jazzy-sensor-msgs \
        ros-jazzy-std-msgs \
        ros-jazzy-std-srvs \
        ros-jazzy-tf2-msgs \
        ros-jazzy-visualization-msgs \
    && rm -rf /var/lib/apt/lists/*
# What has no package in Ubuntu: bags, compilation, the report's page, ASTERIX. The messages that ROS has compiled
# need the numpy that Ubuntu has.
COPY constraints-ros.txt /tmp/constraints.txt
RUN pip install --break-system-packages --no-cache-dir -c /tmp/constraints.txt \
        libasterix mcap-ros2-support numba plotly \
    && rm /tmp/constraints.txt

# What .devcontainer opens: the checkout is mounted, and `make` installs into its .venv.
FROM dependencies AS development
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        git \
        iproute2 \
        make \
        python3-hypothesis \
        python3-pytest \
        python3-pytest-timeout \
        python3-venv \
        ros-jazzy-ament-flake8 \
        ros-jazzy-ament-pep257 \
        ros-jazzy-launch-testing \
        ros-jazzy-shape-msgs \
        ros-jazzy-unique-identifier-msgs \
    && rm -rf /var/lib/apt/lists/* \
    && echo "source /opt/ros/jazzy/setup.bash" >>/etc/bash.bashrc
USER ubuntu

FROM dependencies AS runtime
WORKDIR /workspace
COPY . src/phd_jdtc_ros
RUN source /opt/ros/jazzy/setup.bash \
    && colcon build --packages-select phd_jdtc_ros \
    && rm -rf build log src \
    && install -d -o ubuntu -g ubuntu /data
USER ubuntu
# Where files come in and go out:  docker run -v "$PWD:/data" ...
WORKDIR /data
ENTRYPOINT ["/bin/bash", "-c", "source /workspace/install/setup.bash && exec \"$@\"", "--"]
CMD ["ros2", "run", "phd_jdtc_ros", "demo", "--out", "/tmp/demo"]
