"""Files with messages of topics: MCAP and bags of ROS 2."""
