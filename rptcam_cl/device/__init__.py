"""OpenCL devices, programs and buffers: the only room that imports pyopencl, and it knows no scene and no lens."""
