/*
 * The same as the functions of system_calls.py, which take their place where this is not compiled, in a third of the
 * time: without an error for what is usual, without handing the interpreter over to other threads for what does not
 * wait, and with one call for each wait. docs/adr/0043-system-calls-in-c.md
 *
 * A signal that ends a call has its handlers in Python called, as in Python's own functions (PEP 475).
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <errno.h>
#include <poll.h>
#include <sys/epoll.h>
#include <time.h>
#include <unistd.h>

/* The most bytes of a read, and the most descriptors that a wait finds. */
#define MOST_READ 4096
#define MOST_FOUND 64

/* The last part of a wait, in seconds: the kernel may end one late by a thousandth of it. */
#define EXACT_PART 0.06

/* The number of the call on every machine of ours; headers older than Linux 5.11 have no name for it. */
#ifndef EPOLL_PWAIT2
#define EPOLL_PWAIT2 441
#endif

/* Its time: 64 bits each, also where those of the C library have 32. */
struct kernel_time {
    long long seconds, nanoseconds;
};

/* Whether a call is to be made again: a signal has ended it, and no handler has raised an error. */
static int is_interrupted(ssize_t result)
{
    return result < 0 && errno == EINTR && PyErr_CheckSignals() == 0;
}

/* Whether a call has failed because there is nothing to read, or no room to write. */
static int would_wait(void)
{
    return errno == EAGAIN && !PyErr_Occurred();
}

/* Raise what a handler has raised, or else OSError. */
static PyObject *failed(void)
{
    return PyErr_Occurred() ? NULL : PyErr_SetFromErrno(PyExc_OSError);
}

/* Take the first of two arguments, a descriptor. Returns 0 with an error set if it is none. */
static int take_descriptor(PyObject *const *arguments, Py_ssize_t count, int *descriptor)
{
    if (count != 2) {
        PyErr_SetString(PyExc_TypeError, "two arguments are needed");
        return 0;
    }
    long number = PyLong_AsLong(arguments[0]);
    *descriptor = number == (int)number ? (int)number : -1;
    return *descriptor >= 0 || !PyErr_Occurred();
}

static PyObject *read_bytes(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t count)
{
    char data[MOST_READ];
    int descriptor;
    if (!take_descriptor(arguments, count, &descriptor))
        return NULL;
    Py_ssize_t most = PyLong_AsSsize_t(arguments[1]), size;
    if (most < 0 || most > MOST_READ)
        return PyErr_Occurred() ? NULL : PyErr_Format(PyExc_ValueError, "0 to %d bytes can be read", MOST_READ);
    do
        size = read(descriptor, data, (size_t)most);
    while (is_interrupted(size));
    if (size >= 0)
        return PyBytes_FromStringAndSize(data, size);
    return would_wait() ? Py_NewRef(Py_None) : failed();
}

/* Read into the buffer of an object, or write what it has. Returns `not_now` if that would have to wait. */
static PyObject *transfer(PyObject *const *arguments, Py_ssize_t count, int is_reading, long not_now)
{
    Py_buffer buffer;
    int descriptor, flags = is_reading ? PyBUF_WRITABLE : PyBUF_SIMPLE;
    if (!take_descriptor(arguments, count, &descriptor) || PyObject_GetBuffer(arguments[1], &buffer, flags) < 0)
        return NULL;
    ssize_t size;
    do
        size = is_reading ? read(descriptor, buffer.buf, (size_t)buffer.len)
                          : write(descriptor, buffer.buf, (size_t)buffer.len);
    while (is_interrupted(size));
    int error = errno;
    PyBuffer_Release(&buffer);
    errno = error;
    if (size >= 0)
        return PyLong_FromSsize_t(size);
    return would_wait() ? PyLong_FromLong(not_now) : failed();
}

static PyObject *read_into(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t count)
{
    return transfer(arguments, count, 1, -1);
}

static PyObject *write_bytes(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t count)
{
    return transfer(arguments, count, 0, 0);
}

/* Wait for so many seconds, to the nanosecond. A kernel before 5.11, and who forbids what he does not know, has no call
 * for that: then wait for the descriptor of the epoll itself. */
static int wait_exactly(int poll, struct epoll_event *found, double seconds)
{
    static int is_there = 1;
    long long whole = (long long)seconds;
    struct kernel_time most = {whole, (long long)((seconds - (double)whole) * 1e9) + 1};
    if (most.nanoseconds >= 1000000000)
        most = (struct kernel_time){whole + 1, 0};
    if (is_there) {
        int count = (int)syscall(EPOLL_PWAIT2, poll, found, MOST_FOUND, &most, NULL, 0);
        if (count >= 0 || (errno != ENOSYS && errno != EPERM))
            return count;
        is_there = 0;
    }
    struct timespec until = {(time_t)most.seconds, (long)most.nanoseconds};
    struct pollfd own = {poll, POLLIN, 0};
    int count = ppoll(&own, 1, &until, NULL);
    return count > 0 ? epoll_wait(poll, found, MOST_FOUND, 0) : count;
}

/* What `known` has for each of these descriptors, and its events. Only the thread that waits changes it. */
static PyObject *as_tuple(const struct epoll_event *found, int count, PyObject *known)
{
    PyObject *result = PyTuple_New(2 * count);
    for (int i = 0; result != NULL && i < count; i++) {
        PyObject *descriptor = PyLong_FromLong(found[i].data.fd);
        PyObject *its = descriptor == NULL ? NULL : PyDict_GetItemWithError(known, descriptor);
        Py_XDECREF(descriptor);
        PyTuple_SET_ITEM(result, 2 * i, Py_NewRef(its == NULL ? Py_None : its));
        PyTuple_SET_ITEM(result, 2 * i + 1, PyLong_FromUnsignedLong(found[i].events));
    }
    if (result != NULL && PyErr_Occurred())
        Py_CLEAR(result);
    return result;
}

/* `poll` is the number of the epoll. Only what may really wait hands the interpreter over to other threads. */
static PyObject *wait_with(PyObject *poll, PyObject *const *arguments, Py_ssize_t argument_count)
{
    struct epoll_event found[MOST_FOUND];
    int count, descriptor = (int)PyLong_AsLong(poll);
    if (argument_count != 2 || !PyDict_Check(arguments[1]))
        return PyErr_Format(PyExc_TypeError, "seconds and a dict are needed");
    double seconds = PyFloat_AsDouble(arguments[0]);
    if (PyErr_Occurred())
        return NULL;
    if (seconds > EXACT_PART)
        seconds -= EXACT_PART;
    if (seconds > 0.0) {
        Py_BEGIN_ALLOW_THREADS
        count = wait_exactly(descriptor, found, seconds);
        Py_END_ALLOW_THREADS
    } else {
        count = epoll_wait(descriptor, found, MOST_FOUND, 0);
    }
    if (is_interrupted(count))
        count = 0;
    return count < 0 ? failed() : as_tuple(found, count, arguments[1]);
}

static PyObject *wait_of(PyObject *Py_UNUSED(module), PyObject *poll)
{
    static PyMethodDef wait = {"wait", (PyCFunction)(void (*)(void))wait_with, METH_FASTCALL, NULL};
    int descriptor = PyObject_AsFileDescriptor(poll);
    PyObject *number = descriptor < 0 ? NULL : PyLong_FromLong(descriptor);
    PyObject *bound = number == NULL ? NULL : PyCFunction_New(&wait, number);
    Py_XDECREF(number);
    return bound;
}

static PyMethodDef functions[] = {
    {"read", (PyCFunction)(void (*)(void))read_bytes, METH_FASTCALL, NULL},
    {"read_into", (PyCFunction)(void (*)(void))read_into, METH_FASTCALL, NULL},
    {"write", (PyCFunction)(void (*)(void))write_bytes, METH_FASTCALL, NULL},
    {"wait_of", wait_of, METH_O, NULL},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef_Slot slots[] = {
#ifdef Py_mod_gil
    {Py_mod_gil, Py_MOD_GIL_NOT_USED},
#endif
    {0, NULL},
};

static struct PyModuleDef module = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "_system_calls",
    .m_methods = functions,
    .m_slots = slots,
};

PyMODINIT_FUNC PyInit__system_calls(void)
{
    return PyModuleDef_Init(&module);
}
